// What (h^2 + h beta) K is taken of in an element's right-hand side: the velocity v; or, where the element is linearised at the
// trial change x, (beta v - h x) / (h + beta), since h f holds h^2 K (v + x) already. Needs AGAIN, `params`, `velocity` and
// `trial_change`.

vec3 lag(uint node, float beta) {
    vec3 v = fetch(velocity, node).xyz;
    return AGAIN ? (beta * v - params.dt * fetch(trial_change, node).xyz) / (params.dt + beta) : v;
}
