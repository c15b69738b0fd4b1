"""Published numbers of other authors, reproduced through the public interface."""
