"""Linear map over a stretch of a run: variations at its end due to variations at its start and of parameters.

The stretch is integrated again by a one-step method with error control, and each step is differentiated exactly. (An
integrator of the variational equations would factorise one matrix for all directions together, and need derivatives of
the Jacobian.) ODEs start with explicit steps of order 8 and switch to Radau IIA of order 9 (`radau.py`) when they turn
out to be stiff. `steps.c` does the same in compiled code.

None of the four loops can stand for another one (`benchmarks/sensitivities.py`, processor time). Without C, derivatives
of ThickBlock take 17 times as long and those of 40 masses 20 times; without Python there are none where no compiler is.
With Radau alone, those of 40 masses take eight times as long in Python.
"""
