// The contact law: the one place where the shaders compute pressure, its slope and friction of a contact (a vertex of
// one body's surface inside the other body). An including shader includes shared/types.glsl first.
//
// Pressure p = k delta + d delta' (Kelvin-Voigt penalty, N/m^2), with penetration depth delta (m), its rate delta'
// (m/s), stiffness k (N/m^3) and damping d (N s/m^3). The solver uses p at the end of a step of h seconds. It is
// k delta + (h k + d) delta', with delta at the start and delta' at the end, and linear in the change of velocity.
//
// Friction is regularised Coulomb friction, -c v_t, with the tangential velocity v_t at the end of the step. Its
// coefficient c = mu a max(0, p) / sqrt(u^2 + s^2) is computed at the start, with friction coefficient mu, contact
// area a (m^2), s the speed (m/s) below which friction is viscous, and u a prediction of |v_t|: with |v_t| at the start in
// its place, friction would be too great by the share by which the speed grows in a step.
//
// The f64 reference implementation is oracle::contact_law; the version of the host (CPU side) is in
// stages/contact_law.rs.

// Pressure p at the start of the step, N/m^2.
float start_pressure(float depth, float rate, float stiffness, float damping) {
    return stiffness * depth + damping * rate;
}

// Prediction of |v_t| at the end of the step, m/s, from v_t at the start and the change of v_t over the last step (m/s):
// the change will be the same again, but the speed will at most double and at least halve.
float predicted_slip(vec3 slip, vec3 change) {
    float now = length(slip), next = length(slip + change);
    return is_nan(next) ? now : clamp(next, 0.5 * now, 2.0 * now);
}

// Coefficient c of friction, N s/m, from the normal force (N) at the start of the step and the predicted slip u (m/s).
float friction_coefficient(float force, float slip, float mu, float speed) {
    return mu * max(0.0, force) / sqrt(slip * slip + speed * speed);
}

// Slope dp/d(delta') of the pressure at the end of a step: h k + d, N s/m^3.
float pressure_slope(Contact contact, float h) { return h * contact.stiffness + contact.damping; }

// Normal term of a contact in the solver's operator: (h^2 k + h d) a, kg.
float normal_operator(Contact contact, float h) { return h * pressure_slope(contact, h) * contact.area; }

// Tangential term of a contact in the solver's operator: h c, kg.
float friction_operator(Contact contact, float h) { return h * contact.friction; }

// Normal impulse of a contact if no velocity changed over the step: h a k delta + (h^2 k + h d) a delta', N s.
float normal_impulse(Contact contact, float h) {
    return h * contact.area * contact.stiffness * contact.depth + normal_operator(contact, h) * contact.rate;
}

// Pressure p at the end of the step, N/m^2, for a solution x of the system; `force` is the contact's output of
// solve/contact_product for x. The pressure is negative where the contact is under tension.
float end_pressure(Contact contact, vec4 force, float h) {
    float slope = pressure_slope(contact, h);
    float rate = contact.rate + force.w / (h * slope * contact.area);
    return contact.stiffness * contact.depth + slope * rate;
}

// Friction on body b at the end of the step, N; the opposite acts on body a. `force` is as for end_pressure.
vec3 end_friction(Contact contact, vec4 force, float h) {
    return contact.friction * contact.slip + (force.xyz - force.w * contact.normal) / h;
}

// Stiffness (N/m) and damping (N s/m) of a contact along its normal, as the tool (rigid body that the haptic device
// leads) feels them.
float normal_stiffness(Contact contact) { return contact.area * contact.stiffness; }
float normal_damping(Contact contact) { return contact.area * contact.damping; }

// Contacts do not adhere: a contact that is under tension when the solver has converged is released, and has no effect
// from then on. It keeps its numbers, with its stiffness negated, until the solve ends (solve/conclude), because the
// right-hand side b still contains its impulses; solve/contact_product cancels them in the last product.
void release(inout Contact contact) { contact.stiffness = -contact.stiffness; }

bool is_released(Contact contact) { return contact.stiffness <= 0.0; }

// Whether a contact was released in the present solve.
bool is_just_released(Contact contact) { return contact.stiffness < 0.0; }

// Takes its numbers from a contact that was released in a solve which has ended.
void clear_released(inout Contact contact) {
    contact.stiffness = 0.0;
    contact.damping = 0.0;
    contact.friction = 0.0;
}
