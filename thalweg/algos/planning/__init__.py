"""What planners share: a model of the environment and its fitting, imagined futures, the search for a plan, and the
policy that plans. How candidates are weighed is the algorithm, and stands in its file."""
