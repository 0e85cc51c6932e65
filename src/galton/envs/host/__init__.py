"""Environments outside JAX: Gymnasium's, vector environments that the user made, and batched MuJoCo tasks."""
