// The shading normal, in the world's axes. Requires common_math, surface_inputs. Provides shading_normal.

// Tangent frame from screen derivatives: no tangents are stored, any mesh with st will do.
// Christian Schueler, "Normal Mapping without Precomputed Tangents", ShaderX5, 2006, and its follow-up, 2013.
mat3 tangent_frame(vec3 normal, vec3 position, vec2 st)
{
    vec3 positionDx = dFdx(position);
    vec3 positionDy = dFdy(position);
    vec2 stDx = dFdx(st);
    vec2 stDy = dFdy(st);
    vec3 acrossDy = cross(positionDy, normal);
    vec3 acrossDx = cross(normal, positionDx);
    vec3 tangent = acrossDy * stDx.x + acrossDx * stDy.x;
    vec3 bitangent = acrossDy * stDx.y + acrossDx * stDy.y;
    // One scale for both keeps a sheared mapping sheared; 1e-37 guards an st that is constant over the pixel. The
    // numerator cancels the squares of tiny derivatives in a deep zoom.
    float largest = max(max_component(abs(tangent)), max_component(abs(bitangent)));
    float inverse = 1.0 / max(largest, 1e-37);
    tangent *= inverse;
    bitangent *= inverse;
    float scale = inversesqrt(max(max(dot(tangent, tangent), dot(bitangent, bitangent)), 1e-30));
    return mat3(tangent * scale, bitangent * scale, normal);
}

// The interpolated normal, turned towards the camera's side of the surface, with the normal map applied.
vec3 shading_normal(vec3 interpolated, vec3 position, bool frontFacing)
{
    vec3 facet = safe_normalize(cross(dFdx(position), dFdy(position)), vec3(0.0, 0.0, 1.0));
    vec3 normal = safe_normalize(interpolated, facet);
    normal = frontFacing ? normal : -normal;
#ifdef NORMAL_TEXTURE
    vec3 tangentNormal = input_normal();
    normal = safe_normalize(tangent_frame(normal, position, NORMAL_ST) * tangentNormal, normal);
#endif
    return normal;
}
