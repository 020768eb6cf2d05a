"""Models taught from one camera's own 2-D tracks: against 3-D, of other people, and of few takes by one person."""
