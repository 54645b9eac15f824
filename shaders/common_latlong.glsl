// Latitude-longitude images as OpenEXR and UsdLux define them: +y at the top, +z in the middle, +x a quarter from the left.
// Requires common_math. Provides latlong_uv, latlong_direction. (0, 0) is the upper left corner: row 0 is uploaded first.

vec2 latlong_uv(vec3 direction)
{
    float longitude = atan(direction.x, direction.z);
    float latitude = asin(clamp(direction.y, -1.0, 1.0));
    return vec2(0.5 - 0.5 * INV_PI * longitude, 0.5 - INV_PI * latitude);
}

vec3 latlong_direction(vec2 uv)
{
    float longitude = (0.5 - uv.x) * 2.0 * PI;
    float latitude = (0.5 - uv.y) * PI;
    return vec3(cos(latitude) * sin(longitude), sin(latitude), cos(latitude) * cos(longitude));
}
