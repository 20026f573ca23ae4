// Jacobian J of a contact with respect to the twist (linear and angular velocity) of the tool, the rigid body that the
// haptic device leads.

// Column of J^T for a direction: the derivative, by the tool's twist, of the relative velocity of the contact's two
// points along that direction.
void tool_column(Contact contact, vec3 direction, out float column[6]) {
    vec3 lever = contact.tool_sign * cross(contact.arm, direction);
    for (int k = 0; k < 3; k++) {
        column[k] = contact.tool_sign * direction[k];
        column[3 + k] = lever[k];
    }
}

// Two unit tangents, perpendicular to the unit vector n and to each other.
void tangents(vec3 n, out vec3 along[2]) {
    along[0] = normalize(cross(n, abs(n.x) < 0.6 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0)));
    along[1] = cross(n, along[0]);
}
