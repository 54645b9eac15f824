// The colour of a camera and the filter that it calls for (Bornik and Ferko 2002, section 3.2, fig. 8 and 16): a
// decision by direction alone, as the paper takes it per polygon. Twin: plugin/fexel/filters/decision.py.
// Requires common_math. Provides decision_color, decision_filter, decision_shear where the AOV `decision` is drawn.
//
// frame: columns along u, along v (directions in which u, v grow while the other stays: gradients, see tangent_frame of
// surface_normal.glsl) and the normal. toCamera: unit vector from the surface. Same axes as the frame.

#ifdef AOV_DECISION

const float DECISION_GREEN = 0.70710678;   // cosine to the normal from which a mipmap will do: ratio up to sqrt 2
const float DECISION_TILTED = 0.5;         // cosine below which shears are worth it: ratio of axes from 2 on
const float DECISION_TANGENT = 0.25;       // half way from an axis to the first shear, of tangent 1/2

// Coordinates along unit vectors in which u alone, v alone and neither change; not negative but for the sign of u v.
vec3 decision_coordinates(vec3 toCamera, mat3 frame)
{
    vec3 u = safe_normalize(frame[0], vec3(0.0));
    vec3 v = safe_normalize(frame[1], vec3(0.0));
    float sine = max(length(cross(u, v)), 1e-3);  // 1e-3 keeps the quotient finite where u and v run alike
    return vec3(dot(u, toCamera) / sine, dot(frame[2], toCamera), dot(v, toCamera) / sine);
}

// Where the line from the surface to the camera meets the triangle of the primaries: B along u, G along the normal,
// R along v; in linear Rec.709, of sum `intensity`, which falls with the camera's distance.
vec3 decision_color(vec3 toCamera, mat3 frame, float intensity)
{
    vec3 coordinates = abs(decision_coordinates(toCamera, frame)).zyx;
    float sum = coordinates.x + coordinates.y + coordinates.z;
    return sum > 1e-6 ? coordinates * (intensity / sum) : vec3(0.0, intensity, 0.0);  // 1e-6: no direction at all
}

// Tangent of the angle between the camera's place seen from above and the nearer axis: (b, 0) about v, (0, c) about u,
// so that x + b y or c x + y runs along that axis alone; y as v, upwards.
vec2 decision_shear(vec3 toCamera, mat3 frame)
{
    vec2 above = decision_coordinates(toCamera, frame).xz;
    vec2 size = abs(above);
    float product = above.x * above.y;
    float tangent = -sign(product) * min(size.x, size.y) / max(max(size.x, size.y), 1e-30);  // 1e-30: seen from above
    return size.x >= size.y ? vec2(0.0, tangent) : vec2(tangent, 0.0);
}

// As fexel.filters.FILTERS numbers them: 0 mipmap, 2 ripmap, 3 fipmap.
float decision_filter(vec3 toCamera, mat3 frame)
{
    float cosine = abs(dot(frame[2], toCamera));
    vec2 shear = abs(decision_shear(toCamera, frame));
    bool isAlongAxis = max(shear.x, shear.y) < DECISION_TANGENT;
    return cosine >= DECISION_GREEN ? 0.0 : isAlongAxis || cosine >= DECISION_TILTED ? 2.0 : 3.0;
}

#endif
