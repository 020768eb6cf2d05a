"""What the whole chain makes of real pictures: films of gestures, a person who waves, people who stand still."""
