// OpenCV's lens model: the distorted from the ideal position on the plane z = 1.
// k: k1 k2 p1 p2 k3 k4 k5 k6.
FN REAL2 distort(REAL2 p, const REAL k[8]) {
  REAL q = p.x * p.x + p.y * p.y;
  REAL one = REAL(1.0f);
  REAL two = REAL(2.0f);
  REAL g = (one + q * (k[0] + q * (k[1] + q * k[4]))) / (one + q * (k[5] + q * (k[6] + q * k[7])));
  return REAL2(p.x * g + two * k[2] * p.x * p.y + k[3] * (q + two * p.x * p.x),
               p.y * g + k[2] * (q + two * p.y * p.y) + two * k[3] * p.x * p.y);
}
