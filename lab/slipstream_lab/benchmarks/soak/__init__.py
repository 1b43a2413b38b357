"""Does anything grow? The whole demo for minutes or days, sampled each second and judged."""
