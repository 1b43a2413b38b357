"""Speed advice on the road: rolling out to turns and stops, and reaching signals when green."""
