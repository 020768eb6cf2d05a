"""Many observers in many scenes before real fusion processes: `make soak`, and what one posterior costs."""
