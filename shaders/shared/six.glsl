// Linear algebra of six unknowns: the twist (linear and angular velocity) of a rigid body. Matrices are stored by rows.

float[6] times(float matrix[36], float x[6]) {
    float y[6];
    for (int i = 0; i < 6; i++) {
        y[i] = 0.0;
        for (int k = 0; k < 6; k++) y[i] += matrix[6 * i + k] * x[k];
    }
    return y;
}

float inner(float x[6], float y[6]) {
    float sum = 0.0;
    for (int k = 0; k < 6; k++) sum += x[k] * y[k];
    return sum;
}

// Inverse of a symmetric matrix by Cholesky decomposition; returns false if the matrix is not positive definite.
bool invert(float a[36], out float inverse[36]) {
    float l[36];
    for (int k = 0; k < 36; k++) {
        l[k] = 0.0;
        inverse[k] = 0.0;
    }
    for (int j = 0; j < 6; j++) {
        for (int i = j; i < 6; i++) {
            float sum = a[6 * i + j];
            for (int k = 0; k < j; k++) sum -= l[6 * i + k] * l[6 * j + k];
            if (i == j) {
                if (is_nan(sum) || sum <= 0.0) return false;
                l[7 * j] = sqrt(sum);
            } else {
                l[6 * i + j] = sum / l[7 * j];
            }
        }
    }
    for (int c = 0; c < 6; c++) {
        float y[6];
        for (int i = 0; i < 6; i++) {
            float sum = i == c ? 1.0 : 0.0;
            for (int k = 0; k < i; k++) sum -= l[6 * i + k] * y[k];
            y[i] = sum / l[7 * i];
        }
        for (int i = 5; i >= 0; i--) {
            float sum = y[i];
            for (int k = i + 1; k < 6; k++) sum -= l[6 * k + i] * inverse[6 * k + c];
            inverse[6 * i + c] = sum / l[7 * i];
        }
    }
    return true;
}
