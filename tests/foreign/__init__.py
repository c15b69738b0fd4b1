"""Systems whose numbers none of us made: what others printed, and the same by the public interface."""
