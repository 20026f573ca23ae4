// Camera, light and surface colours of a rendered image, for shaders/view. Positions are relative to an origin that the
// host (CPU side) chooses.

struct View {
    mat4 clip;              // from positions to clip space
    mat4 light;             // from positions to the shadow map: x and y from 0 to 1, and depth
    vec3 eye;               // position of the camera, m
    vec3 sun;               // unit vector towards the sun, a directional light
    vec3 across[2];         // two unit vectors, perpendicular to each other and to the sun's rays
    vec4 ground;            // ground plane: unit normal, offset, m
    vec3 middle;            // middle of the scene, m
    float reach;            // half the side of the square around the middle that the shadow map covers, m
    float bias;             // how far in front of a point (in depth of the shadow map) something must lie to shade it
    float texel;            // edge of a texel of the shadow map, m
    uint shadow_side;       // texels along a side of the shadow map
};

// How a mesh is coloured. A vertex value is a number at a vertex, such as a pressure, that the colour may show.
struct Material {
    vec4 colour;            // linear; alpha 1: opaque
    float low;              // vertex value at the lower end of the colour scale
    float high;             // vertex value at the upper end of the colour scale
    uint flags;             // bits of the constants below
};

const uint VALUED = 1;      // coloured by the vertex values where these values are above `low`
const uint FLAT = 2;        // flat shading: one normal a triangle
const uint GLASS = 4;       // transparent, less so at the rim
const uint UNLIT = 8;       // the material's own colour, without lighting
const uint EVEN = 16;       // with VALUED: coloured by the scale everywhere, also below `low`
const uint NUMBERED = 32;   // vertex values are whole numbers, and each number has its own colour
const uint BARE = 64;       // no shadow falls on the mesh
const uint SCALE_COLOURS = 256;     // number of colours of the scale in `colours`; as many for whole numbers follow

// Converts a linear colour to sRGB, with an error of 0.1 % (I. Taylor 2012, "sRGB approximations for HLSL").
vec3 shown(vec3 linear) {
    vec3 x = clamp(linear, 0.0, 1.0), second = sqrt(x), fourth = sqrt(second), eighth = sqrt(fourth);
    return max(vec3(0.0), 0.662002687 * second + 0.684122060 * fourth - 0.323583601 * eighth - 0.022541147 * x);
}
