"""The paper, whole: what is trained, every figure, the claims, and the page that says what holds."""
