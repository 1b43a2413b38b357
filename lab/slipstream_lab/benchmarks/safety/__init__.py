"""Emergency stops of platoons of vehicles that are not ideal, by the agents' own objects."""
