"""The linear map of a stretch of a run: variations of its end from those of its start and of parameters.

The stretch is integrated by a one-step method with its own control of the error, and each step is differentiated
exactly: an integrator that carries the directions in its states factorises a matrix of all of them, and needs the
derivatives of its Jacobian. ODEs begin with explicit steps of order 8 (`explicit.py`), and go over to Radau IIA of
order 9 (`radau.py`) where these turn out to be stiff. `steps.c` does the same in compiled code.
"""
