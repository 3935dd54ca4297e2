// Which methods keep to budgets, by errors and times that are given.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include "fastibl/plan/choose_methods.h"

using namespace fastibl;

namespace {

// A mean and a worst error of the object's pixels, squared, for two diffuse methods, and one of the
// plane's for two shadows. The second of each is better and dearer.
MeasuredErrors measured(double rough, double fine, double worst_of_fine) {
  MeasuredErrors errors;
  errors.candidates.diffuse = {{DiffuseMethod::sh9, {}},
                               {DiffuseMethod::irradiance_cube, {-1, 32, 32}}};
  errors.candidates.glossy = {{GlossyMethod::centroid, {}}};
  errors.candidates.self_shadow = {SelfShadowMethod::none};
  errors.candidates.shadow = {{ShadowMethod::directions, {32}}, {ShadowMethod::directions, {256}}};
  errors.candidates.bounce = {BounceMethod::none};
  errors.object = {rough * rough, fine * fine};
  errors.object_worst = {rough * rough, worst_of_fine * worst_of_fine};
  errors.plane = {1e-6, 1e-8};
  return errors;
}

struct Case {
  MeasuredErrors errors = measured(0.03, 0.01, 0.01);
  Costs costs;
  Workload workload;
  Methods asked;
  ChoiceOptions options;
  Choice choose() const { return choose_methods(asked, errors, costs, workload, options); }
  bool fine() const { return choose().at.diffuse == 1; }
  double milliseconds(std::size_t diffuse) const {
    Case alone = *this;
    alone.options = {};
    auto& c = alone.errors.candidates;
    c.diffuse = {c.diffuse[diffuse]}, c.shadow.resize(1);
    alone.errors.object = {1e-4}, alone.errors.object_worst = {1e-4}, alone.errors.plane = {1e-6};
    return alone.choose().milliseconds;
  }
};

}  // namespace

TEST_CASE("an error budget is kept to by what is assured, not by what is expected") {
  Case c;
  c.options.error = 0.04;
  CHECK_FALSE(c.fine());
  c.options.assurance = 1.5;
  CHECK(c.fine());
  CHECK(c.choose().best_assured == doctest::Approx(1.5 * 0.01).epsilon(0.01));
  c.options.error = 0.02, c.options.assurance = 1;
  CHECK(c.fine());
  c.errors = measured(0.03, 0.01, 0.035);  // the worst view exceeds it: as good as can be is wanted
  CHECK(c.fine());
}

TEST_CASE("where no methods keep to the error only those about as good as the best are taken") {
  Case c;
  c.errors = measured(0.0105, 0.01, 0.01);
  c.options.error = 0.001;
  CHECK_FALSE(c.fine());  // 5 % worse is as good
  c.errors = measured(0.015, 0.01, 0.01);
  CHECK(c.fine());
  c.errors.plane = {1e-4, 1e-8};  // the best plane counts
  CHECK(c.choose().at.shadow == 1);
  CHECK(c.choose().best_error == doctest::Approx(0.01).epsilon(0.01));
}

TEST_CASE("a time budget holds for the whole frame, on this machine as slow as it is") {
  Case c;
  const double fine = c.milliseconds(1), rough = c.milliseconds(0);
  REQUIRE(rough < 0.9 * fine);
  c.options.milliseconds = 1.05 * fine;
  CHECK(c.fine());
  c.options.slowdown = 1.1;
  CHECK_FALSE(c.fine());
  c.options.slowdown = 1, c.options.other_milliseconds = 0.1 * fine;
  CHECK_FALSE(c.fine());
  c.options.milliseconds += 0.1 * fine;
  CHECK(c.fine());
  c.options.milliseconds = 1e-6;  // none is quick enough: the quickest
  CHECK_FALSE(c.fine());
}

TEST_CASE("methods in use stay while others are hardly better") {
  Case c;
  c.options.milliseconds = 1e3;
  c.errors = measured(0.011, 0.01, 0.01);
  const Methods best = c.choose().methods;
  Methods rough = best;
  rough.diffuse = DiffuseMethod::sh9, rough.diffuse_settings = {};
  c.options.keep = &rough;
  CHECK_FALSE(c.fine());
  c.errors = measured(0.02, 0.01, 0.01);
  CHECK(c.fine());
  c.options.settled = true;
  CHECK_FALSE(c.fine());
}

TEST_CASE("what is made for each light is paid for once where it stays") {
  const Costs costs;
  const Methods methods;
  Workload moving, still;
  still.light_changes = false;
  CHECK(runs_per_frame(PassId::irradiance, moving) == 1);
  CHECK(runs_per_frame(PassId::irradiance, still) == 1 / kFramesPerLight);
  CHECK(runs_per_frame(PassId::shade, still) == 1);
  CHECK(pass_milliseconds(costs, PassId::composite, methods, still) <
        pass_milliseconds(costs, PassId::composite, methods, moving));  // no new shadow to read
}

TEST_CASE("samples of a lobe are paid for one by one, whatever the material") {
  const Costs costs;
  for (const bool pbr : {false, true}) {
    Workload workload;
    workload.pbr = pbr;
    Methods few, many;
    few.glossy = many.glossy = GlossyMethod::sampled;
    few.glossy_settings.taps = 64, many.glossy_settings.taps = 256;
    const double added = pass_milliseconds(costs, PassId::shade, many, workload) -
                         pass_milliseconds(costs, PassId::shade, few, workload);
    CHECK(added == doctest::Approx(192 * costs.sample * workload.object.shaded * 1e-6));
  }
}

TEST_CASE("rays are paid for by the parts of pixels that they go from, and by the tree's depth") {
  const Costs costs;
  Workload workload, finer, deeper;
  finer.object.found *= 2, deeper.vertices *= 20;
  const auto rays = [&](const Workload& w) {
    Methods by_vertex, traced;
    by_vertex.self_shadow = SelfShadowMethod::transfer;
    traced.self_shadow = SelfShadowMethod::traced_lights;
    return pass_milliseconds(costs, PassId::shade, traced, w) -
           pass_milliseconds(costs, PassId::shade, by_vertex, w);
  };
  CHECK(rays(finer) == doctest::Approx(2 * rays(workload)));
  CHECK(rays(deeper) > 1.1 * rays(workload));
  CHECK(rays(deeper) < 2 * rays(workload));
}
