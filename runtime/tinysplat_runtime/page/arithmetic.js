// What projecting a Gaussian takes (docs/CONVENTIONS.md, "Drawing"), in GLSL that is JavaScript but for its types:
// scalars and constructors of vectors alone, no operators on vectors. Shaders include it, and tests/page runs the same
// text in node.

export const ARITHMETIC = `
const float SCREEN_PIXEL = 0.3;      // px², by which a splat is widened at least
const float LEAST_OWN_PIXEL = 0.125; // of the screen's pixel: what a splat stands for counts as no smaller
const float LEAST_ALPHA = 0.00392156862745098; // 1/255

float dot3(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

vec3 cross3(vec3 a, vec3 b) { return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x); }

// A row of the Jacobian times the principal axes R(q) diag(s); q is wxyz.
vec3 across(vec3 row, vec4 q, vec3 s) {
  float n = 1.0 / sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  float w = q.x * n; float x = q.y * n; float y = q.z * n; float z = q.w * n;
  return vec3(
    s.x * (row.x * (1.0 - 2.0 * (y * y + z * z)) + row.y * 2.0 * (x * y + w * z) + row.z * 2.0 * (x * z - w * y)),
    s.y * (row.x * 2.0 * (x * y - w * z) + row.y * (1.0 - 2.0 * (x * x + z * z)) + row.z * 2.0 * (y * z + w * x)),
    s.z * (row.x * 2.0 * (x * z + w * y) + row.y * 2.0 * (y * z - w * x) + row.z * (1.0 - 2.0 * (x * x + y * y))));
}

// A row of the Jacobian at pixel u (from the principal point, along that row's axis) and depth z.
vec3 jacobian(vec3 row, vec3 forward, float u, float z) {
  return vec3((row.x - u * forward.x) / z, (row.y - u * forward.y) / z, (row.z - u * forward.z) / z);
}

// The lesser eigenvalue of a 2x2 covariance (a, b; b, c) of determinant det.
float lesser(float a, float b, float c, float det) {
  return det / max(0.5 * (a + c + sqrt((a - c) * (a - c) + 4.0 * b * b)), 1e-12);
}

// What a covariance is widened by (px²), and what opacity is multiplied by; own is how wide its photo's pixel is on the screen, 0 without.
vec2 widening(float a, float b, float c, float det, float own) {
  float wide = own > 0.0 ? max(own, LEAST_OWN_PIXEL) : 1.0;
  float wanted = SCREEN_PIXEL * wide * wide;
  float e = max(wanted - (wide > 1.0 ? lesser(a, b, c, det) : 0.0), SCREEN_PIXEL);
  float narrow = det + wanted * (a + c + wanted);
  return vec2(e, wide < 1.0 ? sqrt(narrow / (det + e * (a + c + e))) : 1.0);
}

// Half axes, where the exponent is 1: the longer one as a vector, and the shorter one's length.
vec3 halfAxes(float a, float b, float c, float det) {
  float h = 0.5 * (a - c);
  float root = sqrt(h * h + b * b);
  float large = 0.5 * (a + c) + root;
  float x = a >= c ? h + root : b;
  float y = a >= c ? b : root - h;
  float n = sqrt(x * x + y * y);
  float longer = sqrt(2.0 * large);
  return vec3(n > 0.0 ? longer * x / n : longer, n > 0.0 ? longer * y / n : 0.0, sqrt(2.0 * det / large));
}

// Spherical harmonics along the unit vector (x, y, z), with the signs of 3D Gaussian Splatting.
float Y0() { return 0.28209479177387814; }
float Y1(float y) { return -0.4886025119029199 * y; }
float Y2(float z) { return 0.4886025119029199 * z; }
float Y3(float x) { return -0.4886025119029199 * x; }
float Y4(float x, float y) { return 1.0925484305920792 * x * y; }
float Y5(float y, float z) { return -1.0925484305920792 * y * z; }
float Y6(float x, float y, float z) { return 0.31539156525252005 * (2.0 * z * z - x * x - y * y); }
float Y7(float x, float z) { return -1.0925484305920792 * x * z; }
float Y8(float x, float y) { return 0.5462742152960396 * (x * x - y * y); }
float Y9(float x, float y) { return -0.5900435899266435 * y * (3.0 * x * x - y * y); }
float Y10(float x, float y, float z) { return 2.890611442640554 * x * y * z; }
float Y11(float x, float y, float z) { return -0.4570457994644658 * y * (4.0 * z * z - x * x - y * y); }
float Y12(float x, float y, float z) { return 0.3731763325901154 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y); }
float Y13(float x, float y, float z) { return -0.4570457994644658 * x * (4.0 * z * z - x * x - y * y); }
float Y14(float x, float y, float z) { return 1.445305721320277 * z * (x * x - y * y); }
float Y15(float x, float y) { return -0.5900435899266435 * x * (x * x - 3.0 * y * y); }
float Y16(float x, float y) { return 2.5033429417967046 * x * y * (x * x - y * y); }
float Y17(float x, float y, float z) { return -1.7701307697799304 * z * y * (3.0 * x * x - y * y); }
float Y18(float x, float y, float z) { return 0.9461746957575601 * x * y * (7.0 * z * z - 1.0); }
float Y19(float y, float z) { return -0.6690465435572892 * z * y * (7.0 * z * z - 3.0); }
float Y20(float z) { return 0.10578554691520431 * (z * z * (35.0 * z * z - 30.0) + 3.0); }
float Y21(float x, float z) { return -0.6690465435572892 * z * x * (7.0 * z * z - 3.0); }
float Y22(float x, float y, float z) { return 0.47308734787878004 * (x * x - y * y) * (7.0 * z * z - 1.0); }
float Y23(float x, float y, float z) { return -1.7701307697799304 * z * x * (x * x - 3.0 * y * y); }
float Y24(float x, float y) { return 0.6258357354491761 * (x * x * (x * x - 3.0 * y * y) - y * y * (3.0 * x * x - y * y)); }
`;
