"""The live window: a local page on which sliders move the speed and the parameters of a model."""
