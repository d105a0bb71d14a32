"""The source paper reproduced, corrected and carried on: `make paper`, docs/paper.md.

V. Mariano et al., "Parametric, modal and external excitation identification of machine-tool XY
table using recursive estimators". Each study is a module with a function ``run(report)``; runner.py
runs them. Everything is simulated and estimated by the C core.
"""
