"""Does classification beat regression on the LQR? Three losses, eight seeds each, side by side on all cores."""

import galton

galton.use_all_cores()
env = galton.envs.LQR()
for loss in ("gaussian", "hl-one-hot", "hl-gauss"):
    result = galton.train(env, galton.make_agent(loss=loss), range(8), total_timesteps=100_000)
    returns = result.final("evaluation_return")
    print(f"{loss:12} {returns.mean():8.2f} ± {returns.std():.2f}   (the optimum is {env.optimal_return:.2f})")
