// The methods that a plan chooses from, and how wrong the picture is with each.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/plan/costs.h"
#include "fastibl/scene/methods.h"

namespace fastibl {

struct DiffuseCandidate {
  DiffuseMethod method;
  DiffuseSettings settings;
};
struct GlossyCandidate {
  GlossyMethod method;
  GlossySettings settings;
};
struct ShadowCandidate {
  ShadowMethod method;
  ShadowSettings settings;
};

// Candidates of each step; a single one where it was asked for by name.
struct Candidates {
  std::vector<DiffuseCandidate> diffuse;
  std::vector<GlossyCandidate> glossy;
  std::vector<SelfShadowMethod> self_shadow;
  std::vector<ShadowCandidate> shadow;
  std::vector<BounceMethod> bounce;
};

struct CandidateOptions {
  bool light_stays = false;  // one map serves many frames: it is worth a fit that takes long
  bool baked_shadow = false;
  bool glossy = true;    // false: nothing glossy is shaded, and the default stays
  bool pbr = false;      // GGX reads a chain with its own taps, whatever `stretched` would do
  bool hurried = false;  // there is a time budget
  // Lights have places: only methods that know of single lights shade them where they are.
  bool placed = false;
  bool traced = true;  // the back end has this method
  // For pictures, not a live view: adds what takes a millisecond for a few hundred pixels,
  // `sampled` with 1024 taps and `traced`.
  bool offline = false;
};
// The methods on the frontier of error and time on real maps (docs/light.md, docs/shadow.md). For
// changing light, only methods that change with it: `sh9` and `sh9-lobes` are off by 0.3 % of the
// light while it changes by 2 %. `mip`, which may be within a budget in one light, is off by half
// of what is glossy in another, so that a change of methods would be seen. There, `sh9` and `mip`
// are candidates only where a time budget asks for what is quickest.
Candidates candidates(const Methods& asked, const CandidateOptions& options);

// One candidate of each step, by its index.
struct Combination {
  std::size_t diffuse = 0, glossy = 0, self_shadow = 0, shadow = 0, bounce = 0;
};

// Square of the picture's error by one step alone, with the other steps as they truly are: the mean
// over all views, and the worst view.
struct ErrorAlone {
  double mean = 0, worst = 0;
};

// Squares of the picture's errors in linear light: the RMS over RGB and over the pixels that the
// object covers or its shadow changes by more than 1/255, divided by the mean of the truth there.
// They were measured on samples of the scene, see render/measure_errors.h.
struct MeasuredErrors {
  Candidates candidates;
  // For the object's pixels: [diffuse][glossy][self_shadow][bounce], the mean over all views and
  // the worst view. For the plane's: [shadow][bounce]. The picture's is the sum of one of each.
  std::vector<double> object, object_worst, plane;
  std::vector<ErrorAlone> diffuse, glossy, self_shadow, shadow, bounce;
  // Of one picture: what its pixels' four samples leave, with the truth at each. It is no part of
  // the others.
  std::optional<double> sampling = {};
  LightRays rays = {};
  bool empty() const { return object.empty(); }

  std::size_t index(const Combination& at) const {
    const Candidates& c = candidates;
    return ((at.diffuse * c.glossy.size() + at.glossy) * c.self_shadow.size() + at.self_shadow) *
               c.bounce.size() +
           at.bounce;
  }
  // What to expect of a view: half-way from the mean to the worst, since a chosen method tends to
  // look better on the samples than it is.
  double object_at(const Combination& at) const {
    return 0.5 * (object[index(at)] + object_worst[index(at)]);
  }
  double plane_at(const Combination& at) const {
    return plane[at.shadow * candidates.bounce.size() + at.bounce];
  }
};

}  // namespace fastibl
