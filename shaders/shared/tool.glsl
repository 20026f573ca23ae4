// The tool's six rows of the system. Needs `contacts`, `contact_forces`, SIZE, FRICTION and shared/sum.glsl.

// J^T of the tool at a contact: how the relative velocity along a direction answers to the twist.
void tool_column(Contact contact, vec3 direction, out float column[6]) {
    vec3 lever = contact.tool_sign * cross(contact.arm, direction);
    for (int k = 0; k < 3; k++) {
        column[k] = contact.tool_sign * direction[k];
        column[3 + k] = lever[k];
    }
}

// Unit vectors across a unit vector and across each other.
void tangents(vec3 n, out vec3 along[2]) {
    along[0] = normalize(cross(n, abs(n.x) < 0.6 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0)));
    along[1] = cross(n, along[0]);
}

// sum over contacts of their force in this lane's share, along the tool's rows.
void tool_contact_sum(uint contact_count, out float rows[6]) {
    vec4 low = vec4(0.0), high = vec4(0.0);
    for (uint c = gl_LocalInvocationID.x; c < contact_count; c += SIZE) {
        float sign = contacts[c].tool_sign;
        if (sign == 0.0) continue;
        vec4 force = texelFetch(contact_forces, int(c));
        if (FRICTION) {
            vec3 moment = sign * cross(contacts[c].arm, force.xyz);
            low += vec4(sign * force.xyz, moment.x);
            high.xy += moment.yz;
        } else {
            vec3 lever = sign * cross(contacts[c].arm, contacts[c].normal);
            low += force.w * vec4(sign * contacts[c].normal, lever.x);
            high.xy += force.w * lever.yz;
        }
    }
    low = workgroup_sum(low);
    high = workgroup_sum(high);
    rows = float[6](low.x, low.y, low.z, low.w, high.x, high.y);
}
