// Bounds on the relative error of rounding to f32.

const float HALF_ULP = 6.0e-8;      // half a unit in the last place: error of one rounding
const float ROUNDING = 1.0e-7;      // error of the handful of roundings in a term of the right-hand side b
