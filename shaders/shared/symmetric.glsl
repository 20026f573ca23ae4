// Symmetric 3x3 matrices, stored as two vectors: the diagonal xx yy zz and the off-diagonal xy xz yz.

vec3 symmetric_times(vec3 diagonal, vec3 off, vec3 v) {
    return vec3(diagonal.x * v.x + off.x * v.y + off.y * v.z, off.x * v.x + diagonal.y * v.y + off.z * v.z,
        off.y * v.x + off.z * v.y + diagonal.z * v.z);
}

// Inverse of the matrix with diagonal `a` and off-diagonal `c`, by cofactors.
void symmetric_inverse(vec3 a, vec3 c, out vec3 diagonal, out vec3 off) {
    vec3 co = vec3(a.y * a.z - c.z * c.z, c.y * c.z - c.x * a.z, c.x * c.z - c.y * a.y);
    float determinant = a.x * co.x + c.x * co.y + c.y * co.z;
    diagonal = vec3(co.x, a.x * a.z - c.y * c.y, a.x * a.y - c.x * c.x) / determinant;
    off = vec3(co.y, co.z, c.x * c.y - a.x * c.z) / determinant;
}
