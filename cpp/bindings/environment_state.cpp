#include "bindings/environment_state.h"

#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <optional>
#include <tuple>

namespace fastibl::bindings {
namespace {

using Three = std::array<double, 3>;

Three three(const glm::dvec3& v) { return {v.x, v.y, v.z}; }
glm::dvec3 vector(const Three& v) { return {v[0], v[1], v[2]}; }

py::tuple light_state(const LightPosition& light) {
  const glm::dmat3& m = light.covariance;
  return py::make_tuple(three(light.direction), three(light.position),
                        std::array{three(m[0]), three(m[1]), three(m[2])}, light.radius);
}

LightPosition light_from_state(const py::tuple& state) {
  LightPosition light;
  light.direction = vector(state[0].cast<Three>());
  light.position = vector(state[1].cast<Three>());
  const auto columns = state[2].cast<std::array<Three, 3>>();
  for (int k = 0; k < 3; ++k) light.covariance[k] = vector(columns[std::size_t(k)]);
  light.radius = state[3].cast<double>();
  return light;
}

std::array<double, 13> numbers_of(const MapKnowledge& k) {
  return {k.unseen_sky,     k.unseen_flux,     k.guessed_plane, k.bound_flux,     k.weighed_flux,
          k.weighed_spread, k.bound_doubt,     k.parallax,      k.parallax_doubt, k.prior_flux,
          k.boosted_flux,   double(k.metered), k.scale};
}

MapKnowledge knowledge_from(const std::array<double, 13>& n) {
  return {n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11] != 0, n[12]};
}

// The times by tile and texel, with shape (tiles, stride).
py::object times_state(const Environment& e) {
  if (e.last_seen.empty()) return py::none();
  const TileGrid grid = e.radiance.tiles();
  py::array_t<double> times({grid.count(), grid.stride()});
  for (int tile = 0; tile < grid.count(); ++tile)
    for (int k = 0; k < grid.stride(); ++k) times.mutable_at(tile, k) = e.last_seen.at(tile, k);
  return times;
}

TexelTimes times_from(const py::object& state, TileGrid grid) {
  if (state.is_none()) return {};
  const auto times = state.cast<py::array_t<double, py::array::c_style>>();
  if (times.ndim() != 2 || times.shape(0) != grid.count() || times.shape(1) != grid.stride())
    throw py::value_error("the times of a map of other texels, " + shape_of(times));
  TexelTimes out(grid);
  for (int tile = 0; tile < grid.count(); ++tile) {
    const double* values = times.data(tile, 0);
    if (std::all_of(values, values + grid.stride(), [&](double t) { return t == values[0]; }))
      out.set(tile, values[0]);
    else
      std::copy_n(values, grid.stride(), out.texels(tile));
  }
  return out;
}

}  // namespace

py::tuple environment_state(const Environment& e) {
  e.validate();
  py::list lights;
  for (const LightPosition& light : e.light_positions) lights.append(light_state(light));
  std::optional<std::tuple<Three, Three, double>> box;
  if (e.box) box = {three(e.box->lower), three(e.box->upper), e.box->yaw};
  std::optional<Three> plane;
  if (e.plane_irradiance) plane = three(*e.plane_irradiance);
  return py::make_tuple(
      e.radiance,
      std::array{e.coverage, e.clipped, e.predicted_error, e.predicted_low, e.predicted_high,
                 e.time},
      numbers_of(e.knowledge), three(e.centre), box, plane, lights, times_state(e),
      py::array_t<std::uint16_t>(py::ssize_t(e.variance.size()), e.variance.data()));
}

Environment environment_from_state(const py::tuple& state) {
  Environment e = environment_from(state[0].cast<CubeMap>());
  const auto numbers = state[1].cast<std::array<double, 6>>();
  e.coverage = numbers[0], e.clipped = numbers[1], e.predicted_error = numbers[2];
  e.predicted_low = numbers[3], e.predicted_high = numbers[4], e.time = numbers[5];
  e.knowledge = knowledge_from(state[2].cast<std::array<double, 13>>());
  e.centre = vector(state[3].cast<Three>());
  if (const auto box = state[4].cast<std::optional<std::tuple<Three, Three, double>>>())
    e.box = RoomBox{vector(std::get<0>(*box)), vector(std::get<1>(*box)), std::get<2>(*box)};
  if (const auto plane = state[5].cast<std::optional<Three>>()) e.plane_irradiance = vector(*plane);
  for (const py::handle& light : state[6].cast<py::list>())
    e.light_positions.push_back(light_from_state(light.cast<py::tuple>()));
  e.last_seen = times_from(state[7], e.radiance.tiles());
  const auto variance = state[8].cast<py::array_t<std::uint16_t, py::array::c_style>>();
  e.variance.assign(variance.data(), variance.data() + variance.size());
  e.validate();
  return e;
}

py::tuple main_light_state(const MainLight& light) {
  return py::make_tuple(triple(light.direction), light.solid_angle, light.angular_radius,
                        triple(light.irradiance), light.share,
                        light.place ? py::object(light_state(*light.place)) : py::none());
}

MainLight main_light_from_state(const py::tuple& state) {
  MainLight light;
  light.direction = glm::vec3(vector(state[0].cast<Three>()));
  light.solid_angle = state[1].cast<float>(), light.angular_radius = state[2].cast<float>();
  light.irradiance = glm::vec3(vector(state[3].cast<Three>()));
  light.share = state[4].cast<float>();
  if (!state[5].is_none()) light.place = light_from_state(state[5].cast<py::tuple>());
  return light;
}

}  // namespace fastibl::bindings
