"""Linear map of a stretch of a run: variations of its end due to those of its start and of parameters.

The stretch is integrated again by a one-step method with error control, each step of which is differentiated exactly.
(An integrator of the variational equations would factorise a matrix of all directions, and need derivatives of its
Jacobian.) ODEs start with explicit steps of order 8 and switch to Radau IIA of order 9 (`radau.py`) when they turn out
to be stiff. `steps.c` does the same in compiled code.
"""
