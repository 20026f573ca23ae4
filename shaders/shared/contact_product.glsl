// Product of a contact's part of the operator with a change of velocity p: (h^2 k + h d) a n n.(J p) + h c (I - n n^T) J p,
// with the contact's Jacobian J, normal n, area a, stiffness k, damping d and friction c (shared/contact_law.glsl), over a
// step of h seconds. The tool is the rigid body that the haptic device leads. An including shader includes
// shared/contact_law.glsl first, and declares `params`, `entry_nodes`, `entry_weights` and the constant FRICTION.

// Change of the relative velocity of a contact's two points, m/s: along the normal, and all of it, for friction alone.
struct Relative {
    float speed;
    vec3 velocity;
};

void add(inout Relative relative, vec3 normal, vec3 v) {
    relative.speed += dot(normal, v);
    if (FRICTION) relative.velocity += v;
}

void add_tool(inout Relative relative, Contact contact, float twist[6]) {
    vec3 linear = vec3(twist[0], twist[1], twist[2]), angular = vec3(twist[3], twist[4], twist[5]);
    vec3 lever = contact.tool_sign * cross(contact.arm, contact.normal);
    relative.speed += contact.tool_sign * dot(contact.normal, linear) + dot(lever, angular);
    if (FRICTION) relative.velocity += contact.tool_sign * (linear + cross(angular, contact.arm));
}

vec3 tangential(Contact contact, vec3 v) { return v - dot(contact.normal, v) * contact.normal; }

// Product with the change of velocity whose relative velocity is given; w: its normal part.
vec4 product_with(Contact contact, Relative relative) {
    float force = normal_operator(contact, params.dt) * relative.speed;
    vec3 both = force * contact.normal;
    if (FRICTION) both += friction_operator(contact, params.dt) * tangential(contact, relative.velocity);
    return vec4(both, force);
}

// What the right-hand side b contains of the contact, in the form of a product.
vec4 part_of_rhs(Contact contact) {
    float force = -normal_impulse(contact, params.dt);
    vec3 both = force * contact.normal;
    if (FRICTION) both -= friction_operator(contact, params.dt) * contact.slip;
    return vec4(both, force);
}

// Adds the part of four weighted nodes, the texel `at` of the lists of entries; `v` is a vector at the nodes.
#define ADD_NODES(relative, contact, at, v) { \
    uvec4 nodes = fetch(entry_nodes, at); \
    vec4 weights = fetch(entry_weights, at); \
    add(relative, contact.normal, weights.x * fetch(v, nodes.x).xyz + weights.y * fetch(v, nodes.y).xyz \
        + weights.z * fetch(v, nodes.z).xyz + weights.w * fetch(v, nodes.w).xyz); \
}
