// Strain E of a tetrahedron, and the part of E that the compression penalty acts on. This penalty is a stress that
// keeps a tetrahedron from being pressed flat. mu and lambda are the Lame parameters. An including shader includes
// shared/rotation.glsl. The f64 references are oracle::elastic and oracle::compression.

const float LEAST = 0.3;            // principal stretch (1: undeformed) below which the compression penalty acts
const float STIFFENING = 10.0;      // greatest modulus of the compression penalty, in units of lambda + 2 mu
const float ONSET = 0.02;           // change of stretch below LEAST over which the penalty's modulus rises from zero
const uint JACOBI_SWEEPS = 5;       // sweeps of Jacobi's eigenvalue method, three rotations each

// Strain E = R^T G + (R^T - I), with the displacement gradient G (`g`) and the rotation R of the quaternion (v, w)
// (`q`). The column of R^T - I for a coordinate axis a is 2 v x (v x a) - 2 w v x a, a form in which no two nearly
// equal numbers are subtracted.
mat3 strain(vec4 q, mat3 g) {
    mat3 e;
    for (int k = 0; k < 3; k++) {
        vec3 axis = vec3(k == 0, k == 1, k == 2);
        vec3 turned = cross(q.xyz, axis);
        e[k] = rotate_back(q, g[k]) + 2.0 * (cross(q.xyz, turned) - q.w * turned);
    }
    return e;
}

// One rotation of Jacobi's method for the eigenvalues of a symmetric matrix `a`: makes the entry in row p and column q
// zero. The columns of `axes` become the eigenvectors. p and q are constants, since lavapipe is slow where the index of
// an array is not one.
void jacobi_rotation(const int p, const int q, inout mat3 a, inout mat3 axes) {
    float theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    float t = a[p][q] == 0.0 ? 0.0 : (theta < 0.0 ? -1.0 : 1.0) / (abs(theta) + sqrt(theta * theta + 1.0));
    float c = inversesqrt(t * t + 1.0), s = t * c;
    mat3 turn = mat3(1.0);
    turn[p][p] = c;
    turn[q][q] = c;
    turn[q][p] = s;
    turn[p][q] = -s;
    a = transpose(turn) * a * turn;
    axes = axes * turn;
}

// The part of a strain by which its principal stretches fall below LEAST: the sum of min(0, 1 + e_k - LEAST) n_k n_k^T
// over the eigenvalues e_k and eigenvectors n_k of the strain's symmetric part, by Jacobi's method.
mat3 excess_compression(mat3 strain) {
    mat3 a = 0.5 * (strain + transpose(strain));
    // Where Gershgorin's circles show that no stretch is below LEAST, as nearly everywhere, the loop below has no
    // rounds. This is cheaper than a branch around the loop, which some devices run with all lanes masked.
    vec3 reach = vec3(abs(a[1][0]) + abs(a[2][0]), abs(a[1][0]) + abs(a[2][1]), abs(a[2][0]) + abs(a[2][1]));
    bool clear = all(greaterThan(vec3(1.0 + a[0][0], 1.0 + a[1][1], 1.0 + a[2][2]) - reach, vec3(LEAST)));
    mat3 axes = mat3(1.0);
    for (uint k = 0; k < (clear ? 0 : JACOBI_SWEEPS); k++) {
        jacobi_rotation(0, 1, a, axes);
        jacobi_rotation(0, 2, a, axes);
        jacobi_rotation(1, 2, a, axes);
    }
    mat3 sum = mat3(0.0);
    for (int k = 0; k < 3; k++) sum += min(0.0, 1.0 + a[k][k] - LEAST) * outerProduct(axes[k], axes[k]);
    return sum;
}
