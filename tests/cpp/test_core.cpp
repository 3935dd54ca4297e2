// What the Python side cannot reach of the core.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <limits>
#include <numbers>

#include "fastibl/core/pose.h"
#include "fastibl/scene/response.h"

using namespace fastibl;

TEST_CASE("a rotation vector is the inverse of its rotation up to half a turn") {
  for (const double short_of : {3.0, 1.0, 0.1, 1e-3, 1e-6, 1e-9, 0.0})
    for (const glm::dvec3 towards : {glm::dvec3(1, 0, 0), glm::dvec3(0, -1, 0), glm::dvec3(1, 2, 3),
                                     glm::dvec3(-1e-9, 1, -1)}) {
      CAPTURE(short_of);
      const glm::dvec3 w = (std::numbers::pi - short_of) * glm::normalize(towards);
      const glm::dmat3 rotation = rotation_from_vector(w);
      CHECK(rotation_angle(rotation_from_vector(rotation_vector(rotation)), rotation) < 1e-9);
      if (short_of > 1e-9) CHECK(glm::length(rotation_vector(rotation) - w) < 1e-6);
    }
}

TEST_CASE("decoding what is no number gives 0") {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  CHECK(Response::srgb().decode(nan) == 0);
  CHECK(Response::gamma(2.2).decode(nan) == 0);
}
