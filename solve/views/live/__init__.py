"""Live window: a local page with sliders for the speed and the parameters of a model."""
