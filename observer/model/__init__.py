"""Movement models, learned from recordings and stored in files: protocol in `base.py`, names in `registry.py`.

The default, `stacked.py`, weighs a filter over postures (`phase.py`, `chains.py`), regressions (`trailing_features.py`,
`segment_classifier.py`) and the nearest take (`nearest_take.py`) by `stacker.py`. The paper's own model is in
`symbol_tables.py`.
"""
