"""A decision as the bytes of an ONNX file. ONNX is imported here and nowhere else."""

from types import ModuleType

import numpy as np

from galton.deploy.decision import ACTION, OBSERVATION, Decision
from galton.errors import UsageError
from galton.extras import needed

OPSET, IR_VERSION = 13, 7
"""Of December 2020: ONNX 1.8, and ONNX Runtime from 1.6 on."""
BATCH = "batch"
"""What the first dimension of input and output is called, which may have any size."""


def encode(decision: Decision) -> bytes:
    """A decision's ONNX file, always of the same bytes; UsageError without ONNX, or for steps unknown to it."""
    onnx = _onnx()
    helper, float32 = onnx.helper, onnx.TensorProto.FLOAT
    graph = decision.graph
    described = helper.make_graph(
        [helper.make_node(node.operator, node.inputs, [node.output], **node.attributes) for node in graph.nodes],
        "policy",
        [helper.make_tensor_value_info(OBSERVATION, float32, [BATCH, *decision.observation_shape])],
        [helper.make_tensor_value_info(ACTION, float32, [BATCH, *decision.action_shape])],
        [_tensor(onnx, name, array) for name, array in graph.constants.items()],
    )
    opset = helper.make_operatorsetid("", OPSET)
    model = helper.make_model(described, opset_imports=[opset], ir_version=IR_VERSION, producer_name="galton")
    try:
        onnx.checker.check_model(model, full_check=True)
    except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError) as error:
        told = " ".join(str(error).split())
        raise UsageError(f"the policy's function in galton.deploy.ACTIONS makes no graph of ONNX: {told}") from None
    content: bytes = model.SerializeToString(deterministic=True)
    return content


def _tensor(onnx: ModuleType, name: str, array: np.ndarray) -> object:
    """A constant, in little-endian bytes whatever the machine."""
    kind = onnx.TensorProto.INT64 if array.dtype.kind == "i" else onnx.TensorProto.FLOAT
    content = array.astype(array.dtype.newbyteorder("<")).tobytes()
    return onnx.helper.make_tensor(name, kind, array.shape, content, raw=True)


def _onnx() -> ModuleType:
    with needed("the format onnx", "onnx"):
        import onnx
        import onnx.checker
        import onnx.helper
        import onnx.shape_inference
    return onnx
