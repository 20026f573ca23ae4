// The tool's six rows of the system. Needs `params`, `solve`, `contacts`, `contact_forces`, SIZE and shared/sum.glsl.

// J^T of the tool at a contact: how the contact's normal speed answers to the twist.
void tool_column(Contact contact, out float column[6]) {
    for (int k = 0; k < 3; k++) {
        column[k] = contact.tool_sign * contact.normal[k];
        column[3 + k] = contact.lever[k];
    }
}

// sum over contacts of their force in this lane's share, along the tool's rows.
void tool_contact_sum(uint contact_count, out float rows[6]) {
    vec4 low = vec4(0.0), high = vec4(0.0);
    for (uint c = gl_LocalInvocationID.x; c < contact_count; c += SIZE) {
        if (contacts[c].tool_sign == 0.0) continue;
        float force = texelFetch(contact_forces, int(c)).w;
        low += force * vec4(contacts[c].tool_sign * contacts[c].normal, contacts[c].lever.x);
        high.xy += force * contacts[c].lever.yz;
    }
    low = workgroup_sum(low);
    high = workgroup_sum(high);
    rows = float[6](low.x, low.y, low.z, low.w, high.x, high.y);
}
