"""The fusion service: posteriors -> weights -> pooled posterior -> judgements and verdicts."""
