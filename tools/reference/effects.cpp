// The effects of the diagnosis, from the simulator's registry.
#include "tendril/sim/effects.h"

#include <fmt/format.h>

#include "markdown.h"
#include "reference.h"
#include "tendril/gap/report.h"

namespace tendril::reference {
namespace {

using sim::Effect;

std::string EffectLink(std::string_view name) { return Link(name, "", name); }

std::string CutText(sim::Cut cut) {
  const gap::CutText& text = gap::TextOf(cut);
  return fmt::format("{} {} ({} → {})", sim::CutName(cut), text.title, text.from, text.to);
}

std::string Parameters(const Effect& effect) {
  Table table({"Parameter", "Nominal", "Bounds", "Plainly visible", "In proportion to"});
  for (const sim::EffectParameter& p : effect.parameters) {
    const std::string unit = gap::TextOf(p.name).unit;
    const std::string_view of = sim::TextOf(p.of);
    table.Row({Target(p.name, fmt::format("{}.{}", effect.name, p.name)) +
                   (p.shape ? Below("shape of the law") : ""),
               fmt::format("{:.4g}", p.nominal), fmt::format("{:.4g} .. {:.4g} {}", p.lower, p.upper, unit),
               fmt::format("{:.3g} {}", p.typical, unit), of.empty() ? "—" : Prose(of)});
  }
  return table.Text();
}

std::string Facts(const Effect& effect) {
  std::string shows = CutText(effect.cut);
  if (effect.cut_robot_side != effect.cut)
    shows += fmt::format("; {} with a load cell on the robot's side", CutText(effect.cut_robot_side));
  std::string confused;
  for (const std::string_view name : effect.confusable)
    confused += (confused.empty() ? "" : ", ") + EffectLink(name);
  std::string text =
      fmt::format("- Shows first at {}.\n- Where: {}.\n", Prose(shows), Code(sim::WhereText(effect)));
  text += effect.edit != nullptr ? "- A number of the robot file, so that the controller can use it.\n"
                                 : "- A law of the simulator alone; the controller does not know it.\n";
  if (effect.nuisance) text += "- Nobody can know it beforehand: it is not accused while it is immaterial.\n";
  if (!confused.empty()) text += fmt::format("- Confused with {}.\n", confused);
  return text + "\n";
}

std::string Section(const Effect& effect) {
  return Heading(3, Code(effect.name), effect.name) + Sentence(effect.summary) + "\n\n" + Facts(effect) +
         Parameters(effect) +
         fmt::format("**Law.** {}\n\n**In the data.** {}\n\n**What shows it.** {}\n\n", Prose(effect.physics),
                     Prose(effect.signature), Prose(effect.experiment));
}

std::string Chain() {
  Table table({"Cut", "From → to"});
  for (int i = 0; i < sim::kCuts; ++i) {
    const gap::CutText& text = gap::TextOf(static_cast<sim::Cut>(i));
    table.Row({fmt::format("{} {}", sim::CutName(static_cast<sim::Cut>(i)), text.title),
               fmt::format("{} → {}", text.from, text.to)});
  }
  return table.Text();
}

}  // namespace

Page EffectsPage() {
  std::string text =
      Head("Effects of the diagnosis",
           "What a real robot may have and the nominal model has not, or has with a wrong number. Bounds "
           "and sizes are those of the rig of 90 mm; `tendril gap explain EFFECT --robot FILE` gives "
           "those of another robot, in proportion to the quantity named.",
           {"src/sim/effects"});
  text += Heading(2, "Cuts", "cuts") + Chain();
  Table overview({"Effect", "What it is"});
  std::string each;
  std::string_view stage;
  for (const Effect& effect : sim::Effects()) {
    overview.Row({EffectLink(effect.name) +
                      Below(fmt::format("{}, {}", sim::StageName(effect.stage), sim::CutName(effect.cut))),
                  Prose(effect.summary)});
    if (stage != sim::StageName(effect.stage)) {
      stage = sim::StageName(effect.stage);
      each += Heading(2, fmt::format("Part: {}", stage), fmt::format("part-{}", stage));
    }
    each += Section(effect);
  }
  return {"effects.md", text + Heading(2, "All effects", "all") + overview.Text() + each};
}

}  // namespace tendril::reference
