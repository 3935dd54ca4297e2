#include "fastibl/capture/capture_options.h"

#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {

CaptureOptions checked(CaptureOptions options) {
  const int n = options.size;
  check(n >= 1 && n <= 4096, "the map's size must be 1 to 4096 texels, got ", n);
  const glm::dvec3& centre = options.centre;
  check(std::isfinite(centre.x) && std::isfinite(centre.y) && std::isfinite(centre.z),
        "the centre must be finite, got ", centre.x, " ", centre.y, " ", centre.z);
  check(centre.z > 0, "the centre must lie above the plane (z > 0), got z = ", centre.z);
  check(!options.distance || *options.distance > 0,
        "the distance of the place must be positive (metres), got ", options.distance.value_or(0));
  if (options.box) check_box(*options.box, centre);
  check(!options.prior || options.prior->size() > 0, "the prior map has no texels");
  check(options.paper_albedo > 0 && options.paper_albedo <= 1,
        "the paper's albedo must be in (0, 1], got ", options.paper_albedo);
  check(options.plane_albedo > 0 && options.plane_albedo <= 1,
        "the plane's albedo must be in (0, 1], got ", options.plane_albedo);
  if (options.most_boost)
    check(*options.most_boost >= 1 && std::isfinite(*options.most_boost),
          "lights may be boosted by a finite factor of at least 1, got ", *options.most_boost);
  return options;
}

}  // namespace fastibl
