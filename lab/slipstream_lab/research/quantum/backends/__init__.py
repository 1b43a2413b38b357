"""Back ends that commands and benchmarks have beside the dispatcher's, and Iskay."""
