"""Movement models, learned from recordings and stored in files: protocol in `base.py`, names in `registry.py`.

The default, `stacked.py`, joins `phase.py` (a filter over postures; `chains.py`) and `discriminative.py` (regressions;
`trailing_features.py`, `segment_classifier.py`). The paper's own model is in `symbol_tables.py`.
"""
