// The cost table as Python has it: nanoseconds by name.
#pragma once

#include <map>
#include <string>

#include "fastibl/plan/costs.h"

namespace fastibl::bindings {

// Those of the names that are there; the rest are the built-in ones.
inline Costs costs_from(const std::map<std::string, double>& given) {
  Costs costs;
  for (const CostField& field : cost_fields())
    if (const auto found = given.find(std::string(field.name)); found != given.end())
      costs.*field.value = found->second;
  return costs;
}
inline std::map<std::string, double> costs_map(const Costs& costs) {
  std::map<std::string, double> result;
  for (const CostField& field : cost_fields()) result[std::string(field.name)] = costs.*field.value;
  return result;
}

}  // namespace fastibl::bindings
