// Bounds on relative errors by rounding to f32, for the solver's linear system A x = b.

const float HALF_ULP = 6.0e-8;      // half a unit in the last place: error of one rounding
const float ROUNDING = 1.0e-7;      // error of a term of the right-hand side b, after a handful of roundings
