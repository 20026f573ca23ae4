// What a picture is taken with, and how light falls.

struct View {
    mat4 clip;              // from positions relative to the origin to clip space
    mat4 light;             // to the shadow's: x and y from 0 to 1, depth
    vec3 eye;               // m
    vec3 sun;               // unit, towards the light
    vec3 across[2];         // unit, across its rays
    vec4 ground;            // plane: unit normal, offset, m
    vec3 middle;            // of the scene, m
    float reach;            // how far from there the shadow goes, m
    float bias;             // how far a shadow's caster must lie in front, of the shadow's depth
    float texel;            // edge of a texel of the shadow, m
    uint shadow_side;       // texels
};

struct Material {
    vec4 colour;            // linear; alpha: 1 hides what is behind
    float low;              // values from here on are coloured
    float high;             // and saturate here
    uint flags;
};

const uint VALUED = 1;      // coloured by values where these are above `low`
const uint FLAT = 2;        // faces are flat
const uint GLASS = 4;       // seen through, less so at the rim
const uint UNLIT = 8;       // its colour as it is
const uint EVEN = 16;       // values are colours everywhere, from `low` on
const uint NUMBERED = 32;   // values are whole numbers, each with a colour of its own
const uint BARE = 64;       // no shadow falls on it
const uint SCALE_COLOURS = 256;     // of a scale; as many for numbers follow

// From linear to what a display wants: sRGB, to 0.1 % (I. Taylor 2012, "sRGB approximations for HLSL").
vec3 shown(vec3 linear) {
    vec3 x = clamp(linear, 0.0, 1.0), second = sqrt(x), fourth = sqrt(second), eighth = sqrt(fourth);
    return max(vec3(0.0), 0.662002687 * second + 0.684122060 * fourth - 0.323583601 * eighth - 0.022541147 * x);
}
