// What the start of a solve depends on. An including shader includes shared/types.glsl first.

// Whether this is the first solve of a step, after which none of the step's own solutions is known yet.
bool begins_step(Solve solve) { return solve.newton_iterations == 0; }
