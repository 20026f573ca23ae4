// The contact law: the one place where pressure, its slope and friction of a colliding vertex are computed. Needs
// shared/types.glsl.
//
// Pressure p = k delta + d delta' (Kelvin-Voigt penalty, N/m^2), delta the depth (m), delta' its rate (m/s). The solver takes
// it at the end of a step of h: k delta + (h k + d) delta', linear in the change of velocity.
// Friction, regularised Coulomb's: -c v_t at the end of the step, v_t the tangential velocity, c of its start:
// c = mu a max(0, p) / sqrt(|v_t|^2 + s^2), a the area (m^2), s the speed below which it is viscous (m/s).
// Oracle: oracle::contact_law; the host's twin: stages/contact_law.rs.

// p at the start of the step, N/m^2.
float start_pressure(float depth, float rate, float stiffness, float damping) {
    return stiffness * depth + damping * rate;
}

// c, N s/m, of the force that presses at the start (N) and v_t at the start.
float friction_coefficient(float force, vec3 slip, float mu, float speed) {
    return mu * max(0.0, force) / sqrt(dot(slip, slip) + speed * speed);
}

// dp/d(delta') over a step of h: h k + d, N s/m^3.
float pressure_slope(Contact contact, float h) { return h * contact.stiffness + contact.damping; }

// What the solver's operator holds of a contact along its normal, (h^2 k + h d) a, kg.
float normal_operator(Contact contact, float h) { return h * pressure_slope(contact, h) * contact.area; }

// And across it, h c, kg.
float friction_operator(Contact contact, float h) { return h * contact.friction; }

// The impulse along the normal if no velocity changed, h a k delta + (h^2 k + h d) a delta', N s.
float normal_impulse(Contact contact, float h) {
    return h * contact.area * contact.stiffness * contact.depth + normal_operator(contact, h) * contact.rate;
}

// p at the end of the step, where x solves the system and `force` is what solve/press makes of it; negative where the contact
// would pull.
float end_pressure(Contact contact, vec4 force, float h) {
    float slope = pressure_slope(contact, h);
    float rate = contact.rate + force.w / (h * slope * contact.area);
    return contact.stiffness * contact.depth + slope * rate;
}

// Friction on body b at the end of the step, its opposite on a, N.
vec3 end_friction(Contact contact, vec4 force, float h) {
    return contact.friction * contact.slip + (force.xyz - force.w * contact.normal) / h;
}

// What the tool feels of a contact that moves by a depth (N/m), and at a speed (N s/m).
float normal_stiffness(Contact contact) { return contact.area * contact.stiffness; }
float normal_damping(Contact contact) { return contact.area * contact.damping; }

// Contacts never adhere: one that would pull is dropped, and gives nothing from then on.
void drop(inout Contact contact) {
    contact.stiffness = 0.0;
    contact.damping = 0.0;
    contact.friction = 0.0;
}

bool is_dropped(Contact contact) { return contact.stiffness == 0.0; }
