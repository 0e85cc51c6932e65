"""What is outside JAX: Gymnasium's environments, vector environments that the user made, and batched MuJoCo tasks."""
