// Footprint: the pixel's preimage in texture space.
// Provides Footprint, make_footprint, isotropic_level, footprint_probes, footprint_level. Units: texels of level 0.

struct Footprint {
    float majorAxis;
    float minorAxis;
    vec2 majorDirection;  // texels; its length is majorAxis
};

// Axes of the ellipse that the Jacobian makes of a unit circle: singular values of the matrix with columns dx, dy.
// dx, dy: derivative of the texture coordinate per pixel along x and y, in texels.
Footprint make_footprint(vec2 dx, vec2 dy)
{
    float a = dot(dx, dx);
    float b = dot(dy, dy);
    float c = dot(dx, dy);
    float halfDifference = 0.5 * (a - b);
    float root = sqrt(halfDifference * halfDifference + c * c);
    float majorSquared = max(0.5 * (a + b) + root, 1e-30);  // 1e-30 keeps the inverse finite where st is constant
    float inverseMajor = inversesqrt(majorSquared);
    // Eigenvector of J^T J: (majorSquared - b, c); both parts vanish for a circle, where any direction will do.
    vec2 pixel = halfDifference >= 0.0 ? vec2(halfDifference + root, c) : vec2(c, root - halfDifference);
    float pixelSquared = dot(pixel, pixel);
    pixel = pixelSquared > 0.0 ? pixel * inversesqrt(pixelSquared) : vec2(1.0, 0.0);
    return Footprint(majorSquared * inverseMajor, abs(dx.x * dy.y - dx.y * dy.x) * inverseMajor,
                     dx * pixel.x + dy * pixel.y);
}

// Mip level of an isotropic filter: log2 of the major axis alone.
float isotropic_level(vec2 dx, vec2 dy)
{
    float a = dot(dx, dx);
    float b = dot(dy, dy);
    float c = dot(dx, dy);
    float halfDifference = 0.5 * (a - b);
    float majorSquared = 0.5 * (a + b) + sqrt(halfDifference * halfDifference + c * c);
    return 0.5 * log2(max(majorSquared, 1e-36));  // 1e-36 keeps log2 finite where st is constant
}

// How many isotropic probes cover the footprint, 1 to maxProbes. A ratio a little over a whole number is not worth another.
float footprint_probes(Footprint f, float maxProbes)
{
    return clamp(ceil(f.majorAxis / max(f.minorAxis, 1e-30) - 0.25), 1.0, maxProbes);
}

// Real-valued mip level at which a texel is as wide as the minor axis, or as the share of the major axis that each of the
// most probes allowed has to cover; negative when magnified. It does not depend on the number of probes taken, so it is
// continuous.
float footprint_level(Footprint f, float maxProbes)
{
    return log2(max(max(f.minorAxis, f.majorAxis / maxProbes), 1e-30));  // 1e-30 keeps log2 finite
}
