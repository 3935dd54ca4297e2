#include "fastibl/capture/texel_state.h"

#include <algorithm>
#include <bit>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// A sample further than this many standard deviations from the value is a change of the place.
constexpr float kChange = 4.0f;
// Seconds up to which a value becomes less sure against a new sample the longer ago it was seen.
// What differs much is a change, and noise of a dark exposure must not be averaged in just because
// it was taken a minute later.
constexpr float kLongest = 1.0f;
// Relative difference of samples of a lamp's rim: clipped and unclipped pictures of it are read
// with footprints of different shapes.
constexpr float kRim = 0.3f;
// The same of unclipped samples, where the picture is that uneven: more is a change of the place.
constexpr float kUneven = 0.5f;
constexpr float kMostElapsed = 1e9f;    // seconds: what grows with them stays below that
constexpr float kMostVariance = 1e30f;  // sums of a few stay finite
alignas(64) constexpr int kNoneClipped[kTexelLanes] = {};
alignas(64) constexpr float kEven[kTexelLanes] = {};
constexpr float kBoundNoise = 1.0f;  // relative standard deviation of a value that is only a bound

// Seconds since each texel was last seen, and whether it is seen for the first time.
FASTIBL_CLONES void read_times(double* __restrict last_seen, const int* __restrict seen,
                               double time, int lanes, float* __restrict elapsed,
                               int* __restrict first) {
  const int n = lanes & ~15;
  for (int i = 0; i < n; ++i) elapsed[i] = float(time - last_seen[i]);
  for (int i = 0; i < n; ++i) {
    const int never = elapsed[i] > 1e30f;  // infinite
    first[i] = never;
    const float since = elapsed[i] < kMostElapsed ? elapsed[i] : kMostElapsed;
    elapsed[i] = never ? 0.0f : since;
  }
  for (int i = 0; i < n; ++i) last_seen[i] = seen[i] ? time : last_seen[i];
}

FASTIBL_CLONES void invert_counts(const float* __restrict pixels, int lanes,
                                  float* __restrict inverse) {
  const int n = lanes & ~15;
  for (int i = 0; i < n; ++i) inverse[i] = 1 / (pixels[i] > 1 ? pixels[i] : 1.0f);
}

FASTIBL_CLONES void sensor_variance(const float* __restrict linear,
                                    const float* __restrict inverse_count,
                                    const float* __restrict terms, float more, int lanes,
                                    float* __restrict variance) {
  const int n = lanes & ~15;
  static_assert(SensorNoise::kTerms == 5);
  const float t0 = terms[0], t1 = terms[1], t2 = terms[2], t3 = terms[3], t4 = terms[4];
  for (int i = 0; i < n; ++i) {
    const float y = linear[i] > 0 ? (linear[i] < 1 ? linear[i] : 1.0f) : 0.0f;
    const float fit = t0 + y * (t1 + y * (t2 + y * (t3 + y * t4)));
    const float code = more + (fit > SensorNoise::kReadNoise ? fit : SensorNoise::kReadNoise);
    variance[i] =
        0.25f * code + (0.75f * code + SensorNoise::kShotNoise * linear[i]) * inverse_count[i];
  }
}

// Noise that is cut off at 0 makes dark texels too bright, by 0.4 deviations where there is no
// light: in a short exposure that may be more than the place's own light. Takes that off from
// texels that are too dark to be told from noise, judged by all of the group together. Those that
// are seen for the first time take the mean of them all, because each by itself is either too
// bright or 0. deviation: of a pixel. Returns `linear` where nothing is that dark, or what it left
// in `lowered`.
const float* take_off_noise(const float* linear, const int* seen, const int* firsts,
                            float deviation, int lanes, float* lowered) {
  constexpr float kDark = 2;           // deviations
  constexpr double kRaised = 0.39894;  // deviations: the mean of a normal variable cut off at 0
  constexpr double kFalls = 0.31;      // the brighter the mean, the less it is raised, within 0.01
  const float limit = kDark * deviation;
  double sum = 0;
  int count = 0;
  for (int i = 0; i < lanes; ++i)
    if (seen[i] && linear[i] < limit) sum += double(linear[i]), ++count;
  if (count == 0) return linear;
  const double mean = sum / count / double(deviation);
  const double fall = 1 + kFalls * (mean - kRaised), fourth = fall * fall * fall * fall;
  const double raised = std::min(mean, kRaised / (fourth * fourth));
  const float off = float(raised) * deviation, common = float(mean - raised) * deviation;
  for (int i = 0; i < lanes; ++i) {
    const bool dark = seen[i] && linear[i] < limit;
    lowered[i] = !dark ? linear[i] : firsts[i] ? common : linear[i] - off;
  }
  return lowered;
}

struct ChannelInput {
  const int *seen, *first;
  const float *elapsed, *linear, *scale, *sensor;
  const int* clipped;
  const float* spread;
  int lanes;  // of the arrays, a multiple of 16
};

// A Kalman filter per texel. A value is replaced if it is only a bound, which is no measurement, or
// if the sample contradicts it: then the place changed. A clipped sample raises a value below it
// and does no more.
FASTIBL_CLONES void merge_channel(const ChannelInput& in, float* __restrict values,
                                  float* __restrict variances, int* __restrict bounds,
                                  float* __restrict unsure) {
  const int n = in.lanes & ~15;
  const int* __restrict seen = in.seen;
  const int* __restrict firsts = in.first;
  const int* __restrict clips = in.clipped;
  const float* __restrict elapsed = in.elapsed;
  const float* __restrict linear = in.linear;
  const float* __restrict scale = in.scale;
  const float* __restrict sensor = in.sensor;
  const float* __restrict spread = in.spread;
  for (int i = 0; i < n; ++i) {
    const float scaled = linear[i] * scale[i], value = values[i];
    const float sample = scaled < kRadianceCap ? scaled : kRadianceCap;
    const float model = kModelNoise * sample;
    const float noise = sensor[i] * scale[i] * scale[i] + model * model;
    const float sample_variance = noise < kMostVariance ? noise : kMostVariance;
    const float since = elapsed[i] < kLongest ? elapsed[i] : kLongest;
    const float grown = variances[i] + kUnsureRate * kUnsureRate * value * value * since;
    const float difference = sample - value, total = grown + sample_variance;
    // Weights by the value. By the sample, darker ones would count for more, and the mean of what
    // differs at a lamp's rim would lack light.
    const float model_by_value = kModelNoise * value;
    const float about = sensor[i] * scale[i] * scale[i] + model_by_value * model_by_value;
    const float both = grown + (about < kMostVariance ? about : kMostVariance);
    const float gain = grown / (both > 1e-30f ? both : 1e-30f);
    // A clipped sample says nothing about the rim of a lamp that is otherwise seen without
    // clipping. Others differ there, because footprints do: were the last one taken, and not their
    // mean, the lamp's energy would be that of no picture.
    const float larger = kUneven * (value > sample ? value : sample);
    const float uneven = spread[i] * scale[i] < larger ? spread[i] * scale[i] : larger;
    const float rim = clips[i] ? kRim * value : uneven;
    const int replace =
        firsts[i] | bounds[i] | (difference * difference > kChange * kChange * total + rim * rim);
    const int raise = firsts[i] | (value < sample);
    const float measured = replace ? sample : value + gain * difference;
    const float left = replace ? sample_variance : grown * (1 - gain);
    const float raised = raise ? sample : value;
    const int doubt = replace ? raise : 0;  // an "and" would not be vectorised
    const float guessed = doubt ? kBoundNoise * kBoundNoise * sample * sample : variances[i];
    const float lit = measured > 0 ? measured : 0.0f;  // what lies below 0 is noise
    const float next = clips[i] ? raised : lit, next_variance = clips[i] ? guessed : left;
    const int next_bound = clips[i] ? (bounds[i] | doubt) : (bounds[i] & (1 - replace));
    values[i] = seen[i] ? next : value;
    variances[i] = seen[i] ? next_variance : variances[i];
    bounds[i] = seen[i] ? next_bound : bounds[i];
    const float ratio = replace ? 1.0f : gain, counted = clips[i] ? 0.0f : ratio;
    const float most = counted > unsure[i] ? counted : unsure[i];
    unsure[i] = seen[i] ? most : unsure[i];
  }
}

// The variance left where samples were clipped, relative to that of a sample that is not.
FASTIBL_CLONES void compare_clipped(const ChannelInput& in, const float* __restrict values,
                                    const float* __restrict variances, const int* __restrict bounds,
                                    float* __restrict unsure) {
  const int n = in.lanes & ~15;
  const int* __restrict seen = in.seen;
  const int* __restrict clips = in.clipped;
  const float* __restrict scale = in.scale;
  const float* __restrict sensor = in.sensor;
  for (int i = 0; i < n; ++i) {
    const float model = kModelNoise * values[i];
    const float noise = sensor[i] * scale[i] * scale[i] + model * model;
    const float ratio =
        (seen[i] & clips[i] & !bounds[i]) ? variances[i] / (noise > 1e-30f ? noise : 1e-30f) : 0.0f;
    unsure[i] = ratio > unsure[i] ? ratio : unsure[i];
  }
}

FASTIBL_CLONES void add_deviance(const ChannelInput& in, const float* __restrict value,
                                 const float* __restrict rough, float* __restrict deviance) {
  const int n = in.lanes & ~15;
  const int* __restrict seen = in.seen;
  const int* __restrict clips = in.clipped;
  const float* __restrict linear = in.linear;
  const float* __restrict scale = in.scale;
  const float* __restrict sensor = in.sensor;
  for (int i = 0; i < n; ++i) {
    const float scaled = linear[i] * scale[i];
    const float sample = scaled < kRadianceCap ? scaled : kRadianceCap;
    const float model = kModelNoise * (sample > value[i] ? sample : value[i]);
    const float noise = sensor[i] * scale[i] * scale[i] + model * model + rough[i];
    const float difference = sample - value[i];
    const float counted = (clips[i] & (difference < 0)) ? 0.0f : difference;  // a bound agrees
    deviance[i] += seen[i] ? counted * counted / (noise > 1e-30f ? noise : 1e-30f) : 0.0f;
  }
}

FASTIBL_CLONES int split_bounds(const std::uint8_t* __restrict bits, int lanes,
                                int (*__restrict bounds)[kTexelLanes]) {
  const int n = lanes & ~15;
  int any = 0;
  for (int i = 0; i < n; ++i) {
    any |= bits[i];
    for (int c = 0; c < 3; ++c) bounds[c][i] = bits[i] >> c & 1;
  }
  return any;
}

FASTIBL_CLONES void join_bounds(const int (*__restrict bounds)[kTexelLanes], int lanes,
                                std::uint8_t* __restrict bits) {
  const int n = lanes & ~15;
  for (int i = 0; i < n; ++i) {
    const int any = bounds[0][i] | bounds[1][i] << 1 | bounds[2][i] << 2;
    bits[i] = std::uint8_t(any ? any | (bits[i] & kClipsInAll) : 0);
  }
}

FASTIBL_CLONES void mark_clipped(const Samples& samples, const int* __restrict seen, int lanes,
                                 std::uint8_t* __restrict bits) {
  const int n = lanes & ~15;
  for (int i = 0; i < n; ++i) {
    const int clips =
        (samples.clipped[0][i] | samples.clipped[1][i] | samples.clipped[2][i]) & seen[i];
    bits[i] = std::uint8_t(clips && bits[i] ? bits[i] | kClipsInAll : bits[i]);
  }
}

// Variance of a texel over RGB, relative to the square of its value.
FASTIBL_CLONES void relative_variance(const float* const value[3], const float* const variance[3],
                                      int count, std::uint16_t* __restrict out) {
  const float *r = value[0], *g = value[1], *b = value[2];
  const float *vr = variance[0], *vg = variance[1], *vb = variance[2];
  for (int i = 0; i < count; ++i) {
    const float square = r[i] * r[i] + g[i] * g[i] + b[i] * b[i];
    const float relative = (vr[i] + vg[i] + vb[i]) / (square > 1e-20f ? square : 1e-20f);
    out[i] = std::uint16_t(std::bit_cast<std::uint32_t>(relative) >> 16);
  }
}

constexpr int kPartial = 16;  // sums side by side, in the same order on every processor

struct Arrays {
  const float *value[3], *angles, *projected;
  const double* last_seen;
  const std::uint8_t* bound;
};

// What is summed over a group, each as kPartial sums side by side.
enum Sum {
  kCount,
  kAngle,
  kProjected,
  kValue,
  kFlux = kValue + 3,
  kIrradiance = kFlux + 3,
  kBoundAngle = kIrradiance + 3,
  kBoundFlux,
  kSums
};

FASTIBL_CLONES void sum_group(const Arrays& in, int count, float* __restrict sums) {
  const int n = std::min(kTexelLanes, lanes_of(count));
  alignas(64) float seen[kTexelLanes];
  const double* __restrict last_seen = in.last_seen;
  const float* __restrict angles = in.angles;
  const float* __restrict projected = in.projected;
  const std::uint8_t* __restrict bound = in.bound;
  if (last_seen)
    for (int i = 0; i < n; ++i) seen[i] = ((i < count) & (last_seen[i] > -1e300)) ? 1.0f : 0.0f;
  else
    for (int i = 0; i < n; ++i) seen[i] = i < count ? 1.0f : 0.0f;
  const auto add = [&](int which, const Float16& sum) {
    *reinterpret_cast<Float16*>(sums + which * kPartial) += sum;
  };
  Float16 counts = {}, angle = {}, below = {};
  for (int i = 0; i < n; i += kPartial) {
    counts += floats_at<Float16>(seen + i);
    angle += floats_at<Float16>(seen + i) * floats_at<Float16>(angles + i),
        below += floats_at<Float16>(seen + i) * floats_at<Float16>(projected + i);
  }
  add(kCount, counts), add(kAngle, angle), add(kProjected, below);
  for (int c = 0; c < 3; ++c) {
    Float16 plain = {}, flux = {}, irradiance = {};
    for (int i = 0; i < n; i += kPartial) {
      const Float16 v = floats_at<Float16>(seen + i) * floats_at<Float16>(in.value[c] + i);
      plain += v, flux += v * floats_at<Float16>(angles + i),
          irradiance += v * floats_at<Float16>(projected + i);
    }
    add(kValue + c, plain), add(kFlux + c, flux), add(kIrradiance + c, irradiance);
  }
  int bounds = 0;
  for (int i = 0; i < n; ++i) bounds |= bound[i];
  if (bounds == 0) return;
  for (int i = 0; i < n; ++i) seen[i] = bound[i] ? 1.0f : 0.0f;
  Float16 bound_angle = {}, bound_flux = {};
  for (int i = 0; i < n; i += kPartial) {
    const Float16 part = floats_at<Float16>(seen + i) * floats_at<Float16>(angles + i);
    bound_angle += part;
    bound_flux +=
        part * (floats_at<Float16>(in.value[0] + i) + floats_at<Float16>(in.value[1] + i) +
                floats_at<Float16>(in.value[2] + i));
  }
  add(kBoundAngle, bound_angle), add(kBoundFlux, bound_flux);
}

// Adds pairwise.
FASTIBL_CLONES void join_sums(float* __restrict sums, float* __restrict total) {
  for (int i = 0; i < kSums; ++i) {
    float* s = sums + i * kPartial;
    for (int k = 0; k < 8; ++k) s[k] += s[k + 8];
    for (int k = 0; k < 4; ++k) s[k] += s[k + 4];
    total[i] = (s[0] + s[2]) + (s[1] + s[3]);
  }
}

}  // namespace

void merge_samples(TexelState& state, std::size_t first, int count, const Sightings& sightings,
                   const Samples& samples, const SensorNoise& noise, double time, double* last_seen,
                   double common, float* unsure) {
  const int lanes = lanes_of(count);
  alignas(64) float elapsed[kTexelLanes], sensor[kTexelLanes], inverse_count[kTexelLanes];
  alignas(64) int firsts[kTexelLanes], bounds[3][kTexelLanes];
  for (int i = 0; i < lanes; ++i) unsure[i] = sightings.seen[i] ? 0.0f : -1.0f;
  if (last_seen) {
    read_times(last_seen, sightings.seen, time, lanes, elapsed, firsts);
  } else {
    const bool never = common == kNever;
    std::fill_n(elapsed, lanes,
                never ? 0.0f : float(std::min(time - common, double(kMostElapsed))));
    std::fill_n(firsts, lanes, int(never));
  }
  const int bounded = split_bounds(&state.bound[first], lanes, bounds);
  invert_counts(sightings.pixels, lanes, inverse_count);
  alignas(64) float lowered[kTexelLanes];
  for (int c = 0; c < 3; ++c) {
    const float* linear = samples.linear[c];
    if (noise.cut_off() > 0)
      linear = take_off_noise(linear, sightings.seen, firsts, noise.cut_off(), lanes, lowered);
    sensor_variance(linear, inverse_count, noise.code_variance().data(), noise.more(), lanes,
                    sensor);
    const ChannelInput in{sightings.seen,
                          firsts,
                          elapsed,
                          linear,
                          samples.radiance_per_linear,
                          sensor,
                          samples.any_clipped ? samples.clipped[c] : kNoneClipped,
                          samples.fine ? samples.spread[c] : kEven,
                          lanes};
    merge_channel(in, &state.value[c][first], &state.variance[c][first], bounds[c], unsure);
    if (samples.any_clipped)
      compare_clipped(in, &state.value[c][first], &state.variance[c][first], bounds[c], unsure);
  }
  if (bounded || samples.any_clipped) join_bounds(bounds, lanes, &state.bound[first]);
  if (samples.any_clipped && samples.shortest)
    mark_clipped(samples, sightings.seen, lanes, &state.bound[first]);
}

void distrust(TexelState& state, double share) {
  const float square = float(share * share);
  for (int c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < state.value[c].size(); ++i) {
      const float value = state.value[c][i];
      state.variance[c][i] = std::min(state.variance[c][i] + square * value * value, kMostVariance);
    }
}

void scale_texels(TexelState& state, std::size_t first, int count, float factor) {
  for (int c = 0; c < 3; ++c)
    for (std::size_t i = first; i < first + std::size_t(count); ++i) {
      state.value[c][i] *= factor;
      state.variance[c][i] = std::min(state.variance[c][i] * factor * factor, kMostVariance);
    }
}

void relate_variances(TexelState& state, std::size_t first, int count) {
  const float* value[3] = {&state.value[0][first], &state.value[1][first], &state.value[2][first]};
  const float* variance[3] = {&state.variance[0][first], &state.variance[1][first],
                              &state.variance[2][first]};
  relative_variance(value, variance, count, &state.relative[first]);
}

void compare_samples(const float* const value[3], const float* const rough[3], int count,
                     const Sightings& sightings, const Samples& samples, const SensorNoise& noise,
                     float* deviance) {
  const int lanes = lanes_of(count);
  alignas(64) float sensor[kTexelLanes], inverse_count[kTexelLanes];
  invert_counts(sightings.pixels, lanes, inverse_count);
  std::fill_n(deviance, lanes, 0.0f);
  for (int c = 0; c < 3; ++c) {
    sensor_variance(samples.linear[c], inverse_count, noise.code_variance().data(), noise.more(),
                    lanes, sensor);
    add_deviance({sightings.seen, nullptr, nullptr, samples.linear[c], samples.radiance_per_linear,
                  sensor, samples.any_clipped ? samples.clipped[c] : kNoneClipped, kEven, lanes},
                 value[c], rough[c], deviance);
  }
}

TileSums sum_tile(const TexelState& state, std::size_t first, int count, const double* last_seen,
                  const float* angles, const float* projected) {
  alignas(64) float sums[kSums * kPartial] = {};
  for (int group = 0; group < count; group += kTexelLanes) {
    const std::size_t at = first + std::size_t(group);
    const Arrays in{{&state.value[0][at], &state.value[1][at], &state.value[2][at]},
                    angles + group,
                    projected + group,
                    last_seen ? last_seen + group : nullptr,
                    &state.bound[at]};
    sum_group(in, count - group, sums);
  }
  float total[kSums];
  join_sums(sums, total);
  TileSums out;
  out.count = int(total[kCount]);
  out.angle = double(total[kAngle]), out.projected = double(total[kProjected]);
  for (int c = 0; c < 3; ++c) {
    out.value[c] = double(total[kValue + c]), out.flux[c] = double(total[kFlux + c]);
    out.irradiance[c] = double(total[kIrradiance + c]);
  }
  out.bound_angle = double(total[kBoundAngle]), out.bound_flux = double(total[kBoundFlux]);
  return out;
}

}  // namespace fastibl
