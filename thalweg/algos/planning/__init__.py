"""Planning algorithms: a learned model of the environment, imagined rollouts, plan distributions and the policy that
plans. Each algorithm's own file defines how candidate plans are weighted."""
