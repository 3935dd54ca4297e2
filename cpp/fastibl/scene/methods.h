// The named methods by which a frame is made, one for each step, and their settings.
#pragma once

#include <array>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace fastibl {

enum class DiffuseMethod {
  automatic,        // chosen by the map, and by how often it will be read
  nearest_face,     // McGuire et al. 2013: the 1×1 MIP of the face that the normal meets
  six_face,         // Croubois et al. 2014, Eq. 8 and 9
  six_face_exact,   // Eq. 8 with W_F of Eq. 7 in closed form
  sh9,              // Ramamoorthi and Hanrahan 2001: spherical harmonics up to order 2
  sh9_lobes,        // sh9, and the brightest lights as lobes of their own
  irradiance_cube,  // a cube map of irradiance, each texel a cosine sum over a small level
};
enum class GlossyMethod {
  automatic,
  mip,          // Eq. 2: one look-up in the MIP chain at the mirror direction
  centroid,     // one look-up in a chain of round lobes, placed and as wide as fits the lobe best
  stretched,    // two to four such look-ups along the plane of incidence
  sampled,      // filtered importance sampling, any number of taps
  prefiltered,  // look-ups along the plane of incidence in exactly convolved maps, lights included
};
enum class Normalization {
  energy,  // the lobe's average: a white surface in a constant map is white
  paper,   // Eq. 3 as printed: times its directional albedo ρ(θ_v, s)
  exact,   // Eq. 3 with (s + 2)(s + 4)/(8π(2^{−s/2} + s)): never more light than arrives
};
enum class ShadowMethod {
  automatic,
  cap_sum,      // the obstructions of all spheres added, and clamped
  cap_product,  // the product of what each sphere lets through
  directions,   // the union of all spheres, for directions of equal energy
  mesh,         // the shadow of a rigid object's triangles, baked: Scene::baked_shadow
};
enum class SelfShadowMethod {
  automatic,
  none,
  ambient,         // P_V of Eq. 8: the share of directions that are free, whatever the light
  transfer,        // the light of the directions that are free, by vertex and channel
  pixel_transfer,  // transfer, but glossy light with every pixel's lobe, of directions by vertex
  traced_lights,   // transfer, and rays to the brightest light at pixels where vertices do not tell
  traced,          // by rays at every pixel that may lack light
};
enum class BounceMethod {
  automatic,
  none,
  one,  // diffuse light from object to plane, and the light that the shadow takes from the object
};
enum class TrackingMethod {
  automatic,
  frame_marker,  // the corners of one tag, as in the paper
  board,         // robust refinement over all tags of the board, every frame by itself
  edges,         // from frame to frame by the tags' edges; detection to start and to recover
};
// Which camera pictures feed the map.
enum class CaptureMethod {
  single,      // as in the paper: one front picture of one exposure every five seconds
  continuous,  // every picture of both cameras, all exposures merged
};

// Whether a method sums the cells of each pixel's lobe.
inline bool has_pixel_lobes(SelfShadowMethod method) {
  return method == SelfShadowMethod::pixel_transfer || method == SelfShadowMethod::traced_lights;
}
inline bool traces_rays(SelfShadowMethod method) {
  return method == SelfShadowMethod::traced_lights || method == SelfShadowMethod::traced;
}
// Whether a method finds a share of the light for each pixel.
inline bool shares_by_pixel(SelfShadowMethod method) {
  return has_pixel_lobes(method) || traces_rays(method);
}
// Whether a method asks which directions are free.
inline bool knows_directions(SelfShadowMethod method) {
  return method != SelfShadowMethod::none && method != SelfShadowMethod::ambient;
}

// All methods of a step in the order of the enum, without `automatic`.
inline constexpr std::array kDiffuseMethods = {
    DiffuseMethod::nearest_face, DiffuseMethod::six_face,  DiffuseMethod::six_face_exact,
    DiffuseMethod::sh9,          DiffuseMethod::sh9_lobes, DiffuseMethod::irradiance_cube};
inline constexpr std::array kGlossyMethods = {GlossyMethod::mip, GlossyMethod::centroid,
                                              GlossyMethod::stretched, GlossyMethod::sampled,
                                              GlossyMethod::prefiltered};
inline constexpr std::array kNormalizations = {Normalization::energy, Normalization::paper,
                                               Normalization::exact};
inline constexpr std::array kShadowMethods = {ShadowMethod::cap_sum, ShadowMethod::cap_product,
                                              ShadowMethod::directions, ShadowMethod::mesh};
inline constexpr std::array kSelfShadowMethods = {
    SelfShadowMethod::none,           SelfShadowMethod::ambient,       SelfShadowMethod::transfer,
    SelfShadowMethod::pixel_transfer, SelfShadowMethod::traced_lights, SelfShadowMethod::traced};
inline constexpr std::array kBounceMethods = {BounceMethod::none, BounceMethod::one};
inline constexpr std::array kTrackingMethods = {TrackingMethod::frame_marker, TrackingMethod::board,
                                                TrackingMethod::edges};
inline constexpr std::array kCaptureMethods = {CaptureMethod::single, CaptureMethod::continuous};

// The public names ("six-face-exact", "auto"), and the methods by name; for an unknown name these
// throw std::invalid_argument, naming all.
std::string_view name(DiffuseMethod method);
std::string_view name(GlossyMethod method);
std::string_view name(Normalization normalization);
std::string_view name(ShadowMethod method);
std::string_view name(SelfShadowMethod method);
std::string_view name(BounceMethod method);
std::string_view name(TrackingMethod method);
std::string_view name(CaptureMethod method);
DiffuseMethod diffuse_method(std::string_view name);
GlossyMethod glossy_method(std::string_view name);
Normalization normalization(std::string_view name);
ShadowMethod shadow_method(std::string_view name);
SelfShadowMethod self_shadow_method(std::string_view name);
BounceMethod bounce_method(std::string_view name);
TrackingMethod tracking_method(std::string_view name);
CaptureMethod capture_method(std::string_view name);

// A method reads the settings that settings_of() lists for it; the others are ignored.
struct DiffuseSettings {
  int lobes = -1;   // beside nine coefficients, up to 12; −1: as many as the map needs, up to 8
  int size = 16;    // texels along a face of the irradiance cube
  int source = 32;  // at most this many texels along a face of the level that is summed for it
  bool operator==(const DiffuseSettings&) const = default;
};
struct GlossySettings {
  int taps = 0;     // look-ups, 0: the method's own number
  int lights = -1;  // taken out of the map and shaded by themselves, -1: as many as it has, up to 8
  bool operator==(const GlossySettings&) const = default;
};
struct ShadowSettings {
  int directions = 256;  // number of directions that stand for all light
  int fine = 0;          // texels along an edge of a separate map for a compact light, 0: none
  bool operator==(const ShadowSettings&) const = default;
};
inline constexpr int kLeastDirections = 8, kMostDirections = 4096;

// A setting of a method, by its public name.
template <typename Settings>
struct Setting {
  std::string_view name;
  int Settings::*value;
  int least, most;
  std::vector<int> compared;  // values other than the default that are worth a row where all
                              // methods are compared
};
std::vector<Setting<DiffuseSettings>> settings_of(DiffuseMethod method);
std::vector<Setting<GlossySettings>> settings_of(GlossyMethod method);
std::vector<Setting<ShadowSettings>> settings_of(ShadowMethod method);
// The methods that read the settings given with a method: the method itself, or those that
// `automatic` may become with these settings.
std::vector<DiffuseMethod> stands_for(DiffuseMethod method);
std::vector<GlossyMethod> stands_for(GlossyMethod method);
std::vector<ShadowMethod> stands_for(ShadowMethod method);

struct Methods {
  TrackingMethod tracking = TrackingMethod::automatic;
  CaptureMethod capture = CaptureMethod::continuous;
  DiffuseMethod diffuse = DiffuseMethod::automatic;
  DiffuseSettings diffuse_settings = {};
  GlossyMethod glossy = GlossyMethod::automatic;
  GlossySettings glossy_settings = {};
  Normalization normalization = Normalization::energy;
  ShadowMethod shadow = ShadowMethod::automatic;
  ShadowSettings shadow_settings = {};
  SelfShadowMethod self_shadow = SelfShadowMethod::automatic;
  BounceMethod bounce = BounceMethod::automatic;

  static Methods paper() {
    Methods methods;
    methods.tracking = TrackingMethod::frame_marker;
    methods.capture = CaptureMethod::single;
    methods.diffuse = DiffuseMethod::six_face;
    methods.glossy = GlossyMethod::mip;
    methods.normalization = Normalization::paper;
    methods.shadow = ShadowMethod::cap_product;
    methods.self_shadow = SelfShadowMethod::ambient;
    methods.bounce = BounceMethod::none;
    return methods;
  }
  bool operator==(const Methods&) const = default;
};

namespace checks {  // they throw std::invalid_argument
[[noreturn]] void no_such_method(std::string_view step, std::string_view text,
                                 std::string_view all);
[[noreturn]] void no_such_setting(std::string_view method, std::string_view setting,
                                  std::string_view all);
void in_range(std::string_view method, std::string_view setting, int least, int most, int value);
}  // namespace checks

// The method of that name among `methods`; throws std::invalid_argument, naming all, if there is
// none.
template <typename Method, std::size_t N>
Method method_named(std::string_view text, const std::array<Method, N>& methods, const char* step) {
  std::string all;
  for (const Method method : methods) {
    if (name(method) == text) return method;
    all += (all.empty() ? "" : ", ") + std::string(name(method));
  }
  checks::no_such_method(step, text, all);
}

// The settings of a method, some given by name, the others at their defaults. Throws
// std::invalid_argument for a name that the method does not have, naming those that it has, and for
// a value out of range.
template <typename Settings, typename Method>
Settings settings_with(Method method, const std::map<std::string, int>& given) {
  const std::vector<Setting<Settings>> all = settings_of(method);
  Settings settings;
  for (const auto& [key, value] : given) {
    std::string names;
    bool found = false;
    for (const Setting<Settings>& s : all) {
      names += (names.empty() ? "" : ", ") + std::string(s.name);
      if (s.name != key) continue;
      checks::in_range(name(method), s.name, s.least, s.most, value);
      settings.*s.value = value;
      found = true;
    }
    if (!found) checks::no_such_setting(name(method), key, names);
  }
  return settings;
}
// Throws std::invalid_argument where a setting that the method reads is out of range. A default,
// which may stand for the method's own choice, never is.
template <typename Settings, typename Method>
void check_settings(Method method, const Settings& settings) {
  for (const Method one : stands_for(method))
    for (const Setting<Settings>& s : settings_of(one))
      if (settings.*s.value != Settings{}.*s.value)
        checks::in_range(name(one), s.name, s.least, s.most, settings.*s.value);
}
template <typename Settings, typename Method>
std::map<std::string, int> settings_map(Method method, const Settings& settings) {
  std::map<std::string, int> values;
  for (const Setting<Settings>& s : settings_of(method))
    values[std::string(s.name)] = settings.*s.value;
  return values;
}
// Those that are not at their defaults, for settings_with().
template <typename Settings, typename Method>
std::map<std::string, int> given_settings(Method method, const Settings& settings) {
  std::map<std::string, int> values;
  for (const Setting<Settings>& s : settings_of(method))
    if (settings.*s.value != Settings{}.*s.value) values[std::string(s.name)] = settings.*s.value;
  return values;
}
// For example "irradiance-cube [size=16, source=16]"; values that stand for the method's own choice
// are left out.
template <typename Settings, typename Method>
std::string described(Method method, const Settings& settings) {
  std::string text;
  for (const auto& [key, value] : settings_map(method, settings))
    if (value >= 0) text += (text.empty() ? " [" : ", ") + key + "=" + std::to_string(value);
  return std::string(name(method)) + text + (text.empty() ? "" : "]");
}

}  // namespace fastibl
