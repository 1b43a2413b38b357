"""A quantum device as a guest of the dispatch cycle: asked, and never waited for beyond it."""
