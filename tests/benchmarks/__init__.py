"""What a solve costs beside what one would write instead: ratios are printed, never asserted."""
