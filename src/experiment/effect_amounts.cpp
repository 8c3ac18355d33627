#include "tendril/experiment/effect_amounts.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>

#include "tendril/gap/effect_size.h"

namespace tendril::experiment {

std::vector<std::optional<SizedEffect>> AmountsFor(
    const std::vector<std::optional<RequestedSize>>& requested, const Plan& plan, ExperimentOptions options,
    const std::atomic<bool>* stop,
    const std::function<void(const std::string& stage, double share)>& progress) {
  std::vector<std::optional<SizedEffect>> sized(requested.size());
  if (std::none_of(requested.begin(), requested.end(), [](const auto& w) { return w.has_value(); }))
    return sized;
  options.plant_robot = options.controller_robot;
  options.sensor_noise = true;
  std::vector<double> shares(NameRuns(plan).size(), 0.0);
  const ExperimentSet nominal =
      RunSet(plan, options, stop, [&](std::size_t run, double share, const Experiment*) {
        shares[run] = share;
        progress("running the plan without the effects, for their sizes",
                 std::accumulate(shares.begin(), shares.end(), 0.0) / static_cast<double>(shares.size()));
      });
  if (!nominal.trouble.empty())
    throw std::runtime_error("sizes cannot be found, the runs without effects are not complete: " +
                             nominal.trouble);
  const gap::EffectRuler ruler(nominal.data, options.threads);
  for (std::size_t i = 0; i < requested.size(); ++i) {
    if (!requested[i]) continue;
    progress("finding the amounts for the requested sizes",
             static_cast<double>(i) / static_cast<double>(requested.size()));
    sized[i] = AmountFor(*requested[i], [&](const EffectSetting& setting) {
      if (*stop) throw std::runtime_error("stopped");
      return ruler.Of(setting);
    });
  }
  if (*stop) throw std::runtime_error("stopped while looking for the amounts; nothing is written");
  return sized;
}

std::string SizeLine(const SizedEffect& effect) {
  std::string line = fmt::format("{} where={}", effect.setting.name, effect.setting.where);
  for (const auto& [name, value] : effect.setting.values) line += fmt::format(" {}={}", name, value);
  return line + fmt::format(": {:.3g} sigma in {}{}", effect.size.floors, effect.size.channel,
                            effect.limited.empty() ? "" : "; " + effect.limited);
}

std::string TruthJson(const std::string& robot_file, std::uint64_t seed,
                      const std::vector<EffectSetting>& effects,
                      const std::vector<std::optional<RequestedSize>>& requested,
                      const std::vector<std::optional<SizedEffect>>& sized) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  // What the robot's own file has comes first; the requested ones follow.
  const std::size_t own = effects.size() - requested.size();
  for (std::size_t i = 0; i < effects.size(); ++i) {
    nlohmann::ordered_json entry{{"effect", effects[i].name}, {"where", effects[i].where}};
    entry["parameters"] = nlohmann::ordered_json::object();
    for (const auto& [name, value] : effects[i].values) entry["parameters"][name] = value;
    if (i >= own && sized[i - own]) {
      entry["sigma"] = {{"asked", std::abs(requested[i - own]->sigma)},
                        {"reached", sized[i - own]->size.floors},
                        {"channel", sized[i - own]->size.channel},
                        {"limited", sized[i - own]->limited}};
    }
    list.push_back(entry);
  }
  return nlohmann::ordered_json{{"robot", robot_file}, {"seed", seed}, {"effects", list}}.dump(2);
}

}  // namespace tendril::experiment
