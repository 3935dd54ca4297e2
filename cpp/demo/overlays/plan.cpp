#include "demo/overlays/format.h"
#include "demo/overlays/overlay.h"

namespace fastibl::demo {
namespace {

std::string percent(double error) { return fixed(100 * error, 1) + " %"; }

std::string budget(const Plan& plan) {
  std::string text = "plan: methods about " + percent(plan.expected_error()) + " off";
  if (plan.error_budget > 0) text += ", asked " + percent(plan.error_budget);
  if (plan.milliseconds_budget > 0)
    text +=
        ", " + fixed(plan.milliseconds, 1) + " of " + fixed(plan.milliseconds_budget, 0) + " ms";
  return text;
}

}  // namespace

void draw_plan(Canvas& canvas, const View& view) {
  const Plan& plan = view.session.plan();
  const int columns = canvas.columns(0.42);
  std::vector<Line> lines = {{cut(budget(plan), columns), plan.meets_budget() ? kGreen : kOrange}};
  if (const std::optional<double> light = plan.light_error())
    lines.push_back({"the captured light: " + percent(*light) + " unsure"});
  if (plan.light_in_turns) lines.push_back({"the light is made in turns, one step a frame"});
  for (const PlannedPass& p : plan.passes) {
    const std::string pass(name(p.pass.id));
    if (!p.included) {
      lines.push_back({pass + "\t" + cut("left out: " + p.reason, columns), kGrey});
      continue;
    }
    std::string text = p.method;
    if (p.error) text += "  " + percent(*p.error);
    if (p.milliseconds) text += "  " + fixed(*p.milliseconds, 2) + " ms";
    lines.push_back({pass + "\t" + cut(text, columns)});
  }
  canvas.panel(Corner::top_left, lines);
}

}  // namespace fastibl::demo
