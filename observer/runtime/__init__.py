"""The observer process: it reads frames and publishes posteriors."""
