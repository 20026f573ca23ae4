// The velocity that -(h^2 + h beta) K is multiplied with in the right-hand side of an F-bar patch, with step h,
// stiffness-proportional damping beta and stiffness K. In the first Newton iteration this is the node's velocity v.
// Later iterations linearise at the trial change of velocity x of the last solve; in them it is the velocity
// (beta v - h x) / (h + beta), because the elastic impulse of the trial state already contains -h^2 K (v + x). An
// including shader declares NEWTON (whether this is a later Newton iteration), `params`, `velocity` and `trial_change`.

vec3 lag(uint node, float beta) {
    vec3 v = fetch(velocity, node).xyz;
    return NEWTON ? (beta * v - params.dt * fetch(trial_change, node).xyz) / (params.dt + beta) : v;
}
