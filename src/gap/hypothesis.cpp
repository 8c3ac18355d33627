// Candidates from the registry, models from candidates.
#include "hypothesis.h"

#include <algorithm>
#include <cmath>

namespace tendril::gap {

double ScaleOf(const sim::EffectParameter& parameter) {
  if (parameter.typical > 0) return parameter.typical;
  // For a shape parameter: a fraction of its usual value.
  const double usual = 0.3 * std::abs(parameter.nominal);
  return usual > 0 ? usual : 0.05 * (parameter.upper - parameter.lower);
}

std::vector<Candidate> AllCandidates(const RobotParameters& robot, bool load_cell, bool tracker) {
  std::vector<Candidate> candidates;
  for (const sim::Effect& effect : sim::Effects()) {
    const bool of_cell = effect.name.starts_with("cell_"), of_tracker = effect.name.starts_with("tracker_");
    if ((of_cell && !load_cell) || (of_tracker && !tracker)) continue;
    const auto add = [&](sim::Target target) {
      candidates.push_back(
          {&effect, target, sim::TargetText(effect, target), sim::ParametersOf(effect, target, robot)});
      // A law of the file may be there with more, with less, or not at all: the search starts at the file's
      // values.
      const auto law = sim::FindLaw(robot, effect, target);
      if (!law) return;
      const std::vector<double> values = sim::ValuesOf(robot.effects[*law], robot);
      for (std::size_t k = 0; k < values.size(); ++k) {
        sim::EffectParameter& parameter = candidates.back().parameters[k];
        parameter.nominal = values[k];
        parameter.lower = std::min(parameter.lower, values[k]);
        parameter.upper = std::max(parameter.upper, values[k]);
        if (parameter.shape) parameter.starts.clear();
      }
    };
    if (effect.on_all) add(std::nullopt);
    if (!effect.on_one) continue;
    int places = 0;
    if (effect.scope == sim::Scope::kTendon) places = robot.body.tendons();
    if (effect.scope == sim::Scope::kUnit) places = robot.body.units();
    if (effect.scope == sim::Scope::kSection) places = static_cast<int>(robot.body.sections.size());
    // On a robot with one section, "section:1" and "all" are the same.
    if (places == 1 && effect.on_all) continue;
    for (int i = 0; i < places; ++i) add(i);
  }
  return candidates;
}

Model Model::Of(const Candidate& candidate) { return Model{}.With(candidate); }

Model Model::With(const Candidate& candidate) const {
  Model model = *this;
  model.parts.push_back(candidate);
  model.values.conservativeResize(values.size() + candidate.size());
  for (int k = 0; k < candidate.size(); ++k) {
    model.values[values.size() + k] = candidate.parameters[k].nominal;
  }
  return model;
}

Model Model::Alone(int part) const {
  Model one = Of(parts[part]);
  one.derivative_step = derivative_step;
  one.values = values.segment(offset(part), one.size());
  return one;
}

std::string Model::Name() const {
  std::string name;
  for (const auto& part : parts) name += (name.empty() ? "" : " and ") + part.Name();
  return name;
}

const sim::EffectParameter& Model::parameter(int k) const {
  for (const auto& part : parts) {
    if (k < part.size()) return part.parameters[k];
    k -= part.size();
  }
  return parts.back().parameters.back();
}

double Model::nothing(int k) const {
  const std::string& name = parameter(k).name;
  for (const auto& part : parts) {
    if (k >= part.size()) {
      k -= part.size();
      continue;
    }
    for (const auto& p : part.effect->parameters) {
      if (p.name == name) return p.nominal;
    }
    break;
  }
  return 0;  // value of number i in addition to the first's
}

int Model::offset(int part) const {
  int offset = 0;
  for (int i = 0; i < part; ++i) offset += parts[i].size();
  return offset;
}

RobotParameters Model::Robot(const RobotParameters& base) const {
  RobotParameters robot = base;
  int k = 0;
  for (const auto& part : parts) {
    EffectSetting setting{std::string(part.effect->name), part.where, {}};
    for (const auto& p : part.parameters) {
      setting.values.emplace_back(p.name, std::clamp(values[k++], p.lower, p.upper));
    }
    sim::SetLaw(robot, setting);
  }
  return robot;
}

}  // namespace tendril::gap
