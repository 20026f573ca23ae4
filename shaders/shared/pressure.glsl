// The contact law at the end of the step. Needs shared/types.glsl.

// k delta + (h k + d) delta' of an undropped contact, N/m^2, where `force` = (h^2 k + h d) a J x is what solve/apply makes of the
// solution x; negative where it would pull.
float end_pressure(Contact contact, float force, float h) {
    float slope = h * contact.stiffness + contact.damping;
    float rate = contact.rate + force / (h * slope * contact.area);
    return contact.stiffness * contact.depth + slope * rate;
}
