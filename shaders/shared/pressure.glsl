// The contact law at the end of the step, where x solves the system and `force` is what solve/apply makes of it. Needs
// shared/types.glsl.

// k delta + (h k + d) delta' of an undropped contact, N/m^2; negative where it would pull.
float end_pressure(Contact contact, vec4 force, float h) {
    float slope = h * contact.stiffness + contact.damping;
    float rate = contact.rate + force.w / (h * slope * contact.area);
    return contact.stiffness * contact.depth + slope * rate;
}

// c v_t, N: friction on body b, its opposite on a.
vec3 end_friction(Contact contact, vec4 force, float h) {
    return contact.friction * contact.slip + (force.xyz - force.w * contact.normal) / h;
}
