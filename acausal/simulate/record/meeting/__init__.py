"""Where motions or solutions of algebraic equations meet, so that a run may have gone over to another one."""
