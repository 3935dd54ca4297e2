#include "fastibl/scene/environment.h"

namespace fastibl {

Environment environment_from(CubeMap radiance) {
  const std::size_t count = 6 * std::size_t(radiance.size()) * std::size_t(radiance.size());
  Environment environment;
  environment.confidence.assign(count, 1.0f);
  environment.age.assign(count, 0.0f);
  environment.coverage = 1;
  environment.predicted_error = 0;
  environment.radiance = std::move(radiance);
  return environment;
}

}  // namespace fastibl
