"""The referee: posteriors -> weights -> pooled posterior -> judgement and verdict."""
