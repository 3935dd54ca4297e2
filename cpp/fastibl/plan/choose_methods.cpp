#include "fastibl/plan/choose_methods.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace fastibl {
namespace {

constexpr double kAsGood = 1.1;  // times the least error: no eye sees the difference
// Times that differ by no more than this share count as the same: the smaller error decides. Nine
// coefficients for the irradiance are quicker than a cube by less than that, and they jump when the
// light changes.
constexpr double kAsFast = 0.02;

template <typename Visit>
void for_each(const MeasuredErrors& errors, Visit&& visit) {
  const Candidates& c = errors.candidates;
  for (std::size_t d = 0; d < c.diffuse.size(); ++d)
    for (std::size_t g = 0; g < c.glossy.size(); ++g)
      for (std::size_t s = 0; s < c.self_shadow.size(); ++s)
        for (std::size_t b = 0; b < c.bounce.size(); ++b)
          for (std::size_t sh = 0; sh < c.shadow.size(); ++sh) visit(Combination{d, g, s, sh, b});
}

// Visits only combinations with the best of the shadows, for each bounce.
template <typename Visit>
void for_each_best(const MeasuredErrors& errors, Visit&& visit) {
  const Candidates& c = errors.candidates;
  for (std::size_t b = 0; b < c.bounce.size(); ++b) {
    Combination at;
    at.bounce = b;
    std::size_t best = 0;
    for (at.shadow = 0; at.shadow < c.shadow.size(); ++at.shadow) {
      Combination other = at;
      other.shadow = best;
      if (errors.plane_at(at) < errors.plane_at(other)) best = at.shadow;
    }
    at.shadow = best;
    for (at.diffuse = 0; at.diffuse < c.diffuse.size(); ++at.diffuse)
      for (at.glossy = 0; at.glossy < c.glossy.size(); ++at.glossy)
        for (at.self_shadow = 0; at.self_shadow < c.self_shadow.size(); ++at.self_shadow) visit(at);
  }
}

// The combination that the methods name; nothing where one of them is no candidate.
std::optional<Combination> combination_of(const Candidates& c, const Methods& m) {
  const auto find = [](const auto& list, const auto& is) {
    return std::size_t(std::find_if(list.begin(), list.end(), is) - list.begin());
  };
  const auto same = [](const auto& method, const auto& settings) {
    return [&](const auto& one) { return one.method == method && one.settings == settings; };
  };
  const auto equals = [](const auto& value) {
    return [&](const auto& one) { return one == value; };
  };
  const Combination at{
      find(c.diffuse, same(m.diffuse, m.diffuse_settings)),
      find(c.glossy, same(m.glossy, m.glossy_settings)), find(c.self_shadow, equals(m.self_shadow)),
      find(c.shadow, same(m.shadow, m.shadow_settings)), find(c.bounce, equals(m.bounce))};
  const bool all = at.diffuse < c.diffuse.size() && at.glossy < c.glossy.size() &&
                   at.self_shadow < c.self_shadow.size() && at.shadow < c.shadow.size() &&
                   at.bounce < c.bounce.size();
  return all ? std::optional(at) : std::nullopt;
}

}  // namespace

Choice choose_methods(const Methods& asked, const MeasuredErrors& errors, const Costs& costs,
                      const Workload& workload, const ChoiceOptions& options) {
  const Candidates& c = errors.candidates;
  const auto with = [&](const Combination& at) {
    Methods m = asked;
    const DiffuseCandidate& diffuse = c.diffuse[at.diffuse];
    const GlossyCandidate& glossy = c.glossy[at.glossy];
    const ShadowCandidate& shadow = c.shadow[at.shadow];
    m.diffuse = diffuse.method, m.diffuse_settings = diffuse.settings;
    m.glossy = glossy.method, m.glossy_settings = glossy.settings;
    m.self_shadow = c.self_shadow[at.self_shadow], m.bounce = c.bounce[at.bounce];
    m.shadow = shadow.method, m.shadow_settings = shadow.settings;
    return m;
  };
  const auto cost = [&](PassId pass, const Methods& m) {
    return pass_milliseconds(costs, pass, m, workload) * runs_per_frame(pass, workload);
  };
  const auto milliseconds = [&](const Methods& m) {
    double sum = cost(PassId::irradiance, m) + cost(PassId::shade, m);
    if (options.transfer && knows_directions(m.self_shadow)) sum += cost(PassId::self_shadow, m);
    if (options.cast_shadow) sum += cost(PassId::shadow, m);
    if (options.cast_shadow && m.bounce == BounceMethod::one)
      sum += cost(PassId::bounce, m) + cost(PassId::plane, m);
    return sum;
  };
  const auto error = [&](const Combination& at) {
    return std::sqrt(errors.object_at(at) + errors.plane_at(at));
  };
  const auto assured = [&](const Combination& at) {
    return options.assurance *
           std::sqrt(errors.object_worst[errors.index(at)] + errors.plane_at(at));
  };
  double best = std::numeric_limits<double>::infinity(), best_assured = best;
  for_each_best(errors, [&](const Combination& at) {
    best = std::min(best, error(at));
    best_assured = std::min(best_assured, assured(at));
  });
  if (options.settled && options.keep)
    if (const auto at = combination_of(c, *options.keep)) {
      const Methods m = with(*at);
      if (m == *options.keep)
        return {m, *at, error(*at), assured(*at), best, best_assured, milliseconds(m)};
    }
  // Within reach: what the budget allows or, where every choice leaves more than that, as good as
  // the best.
  const double bar = options.error > 0 && best_assured <= options.error ? 0 : kAsGood * best;
  struct Rank {
    int group;      // lower is better
    double value;   // then this
    double second;  // then this
    double cost;    // time or error, whichever is to be small
    bool operator<(const Rank& o) const {
      return group != o.group   ? group < o.group
             : value != o.value ? value < o.value
                                : second < o.second;
    }
  };
  Choice choice, kept;
  Rank first{99, 0, 0, 0}, last{99, 0, 0, 0};
  for_each(errors, [&](const Combination& at) {
    const Methods m = with(at);
    const bool is_kept = options.keep && m == *options.keep;
    const double e = error(at), ms = milliseconds(m), sure = assured(at);
    const bool good = bar > 0 ? e <= bar : sure <= options.error;
    const bool quick = options.milliseconds == 0 ||
                       (ms + options.other_milliseconds) * options.slowdown <= options.milliseconds;
    const bool by_time = options.error > 0 || options.milliseconds == 0;
    const double step = std::floor(std::log(std::max(ms, 1e-9)) / kAsFast);
    const Rank rank = good && quick ? by_time ? Rank{0, step, e, ms} : Rank{0, e, ms, e}
                      : quick ? Rank{1, e, ms, e}
                                    : Rank{2, ms, e, ms};
    const Choice here{m, at, e, sure, 0, 0, ms};
    if (is_kept) kept = here, last = rank;
    if (rank < first) choice = here, first = rank;
  });
  constexpr double kWorthIt = 0.8;
  const bool stays = last.group == first.group && kWorthIt * last.cost <= first.cost;
  if (stays) choice = kept;
  choice.best_error = best, choice.best_assured = best_assured;
  return choice;
}

}  // namespace fastibl
