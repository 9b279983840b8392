"""Where motions or solutions of algebraic equations meet, so that a run may have changed to another one."""
