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

// The positive semi-definite part of a symmetric matrix `a`: its negative eigenvalues become zero. Where signs differ,
// one eigenvalue has a sign of its own and lies at an end of the spectrum. It is the root of the characteristic
// polynomial x^3 - 3 x - 2 r of the deviator, scaled and with the sign for which it is the greatest root; Newton's
// method from 2 approaches it from outside, so that what the last round leaves only adds stiffness: 1e-2 of the greatest
// eigenvalue where this root is nearly a double one (uniaxial stress), else nothing. The projection
// on its eigenvector is the matrix of cofactors over its trace.
mat3 positive_part(mat3 a) {
    // Scaled, so that products of three entries neither overflow nor vanish.
    vec3 sizes = max(max(abs(a[0]), abs(a[1])), abs(a[2]));
    float size = max(max(sizes.x, sizes.y), sizes.z);
    if (size == 0.0) return a;
    a /= size;
    mat3 co = mat3(cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1]));
    float tr = a[0][0] + a[1][1] + a[2][2], minors = co[0][0] + co[1][1] + co[2][2], det = dot(a[0], co[0]);
    if (minors >= 0.0 && tr >= 0.0 && det >= 0.0) return size * a;
    if (minors >= 0.0 && tr <= 0.0 && det <= 0.0) return mat3(0.0);
    float mean = tr / 3.0, direction = det > 0.0 ? 1.0 : -1.0;
    mat3 deviator = a - mat3(mean);
    vec3 squares = deviator[0] * deviator[0] + deviator[1] * deviator[1] + deviator[2] * deviator[2];
    float scale = sqrt((squares.x + squares.y + squares.z) / 6.0);
    deviator *= direction / scale;
    float r = 0.5 * clamp(determinant(deviator), -2.0, 2.0), x = 2.0;
    for (int k = 0; k < 5; k++) x -= (x * x * x - 3.0 * x - 2.0 * r) / max(3.0 * x * x - 3.0, 1e-3);
    mat3 b = deviator - mat3(x);
    co = mat3(cross(b[1], b[2]), cross(b[2], b[0]), cross(b[0], b[1]));
    tr = co[0][0] + co[1][1] + co[2][2];
    // The trace of the cofactors is zero only where this eigenvalue is a double one. It has a sign of its own, so that a
    // double one is zero, and its projection does not matter.
    mat3 projection = co / max(tr, 1e-6);
    float eigenvalue = mean + direction * scale * x;
    return size * (direction > 0.0 ? eigenvalue * projection : a - eigenvalue * projection);
}
