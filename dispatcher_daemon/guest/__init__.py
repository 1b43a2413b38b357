"""A quantum device as a guest of the dispatch cycle: asked each cycle, never waited for beyond it."""
