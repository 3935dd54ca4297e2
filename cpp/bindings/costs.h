// The cost table as Python has it: nanoseconds by name.
#pragma once

#include <algorithm>
#include <map>
#include <string>

#include "fastibl/core/check.h"
#include "fastibl/plan/costs.h"

namespace fastibl::bindings {

// Those of the names that are there; the rest are the built-in ones.
inline Costs costs_from(const std::map<std::string, double>& given) {
  Costs costs;
  std::size_t taken = 0;
  for (const CostField& field : cost_fields())
    if (const auto found = given.find(std::string(field.name)); found != given.end())
      costs.*field.value = found->second, ++taken;
  if (taken == given.size()) return costs;
  for (const auto& [name, value] : given)
    check(std::any_of(cost_fields().begin(), cost_fields().end(),
                      [&](const CostField& field) { return field.name == name; }),
          "costs has no \"", name, "\"; fastibl.default_costs() has all names");
  return costs;
}
inline std::map<std::string, double> costs_map(const Costs& costs) {
  std::map<std::string, double> result;
  for (const CostField& field : cost_fields()) result[std::string(field.name)] = costs.*field.value;
  return result;
}

}  // namespace fastibl::bindings
