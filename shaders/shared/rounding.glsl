// What rounding to f32 makes of a sum.

const float HALF_ULP = 6.0e-8;      // half a unit in the last place
const float ROUNDING = 1.0e-7;      // the same for each of a handful of roundings on the way to b
