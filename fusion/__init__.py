"""The fusion service: posteriors -> weights -> pooled posterior -> judgements and verdicts. It has three parts:

- fusion.engine: what is decided, pure;
- checkpoint: what outlives a process;
- all other modules, the side of the mesh: server, its members of scenes and their workers; ingest, publisher and
  standby, which receive and send; ownership, reconciliation and same_id, which decide who publishes.
"""
