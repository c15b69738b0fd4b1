"""All that is known of a model, as one page."""
