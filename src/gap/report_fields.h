// The fields of report.json, one list per structure, which the writer, the reader and the reference share so
// that they stay consistent. Knows no JSON.
#pragma once

#include <array>

#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

inline constexpr std::array<const char*, 5> kVerdicts{"no_gap", "attributed", "ambiguous_group",
                                                      "unexplained", "insufficient_data"};
inline constexpr std::array<const char*, 3> kSeverities{"info", "warning", "error"};

/// `a(key, member)` for every field; A::Ref<T> is how A takes a structure, to read or to fill it.
template <class A>
void Fields(A& a, typename A::template Ref<CutFinding> f) {
  a("where", f.where);
  a("quantity", f.quantity);
  a("unit", f.unit);
  a("measured", f.measured);
  a("rms", f.rms);
  a("floor", f.floor);
  a("excess_sigma", f.excess_sigma);
  a("delta", f.delta);
  a("p_value", f.p_value);
  a("excess", f.excess);
  a("first", f.first);
  a("note", f.note);
}

template <class A>
void Fields(A& a, typename A::template Ref<Cause> c) {
  a("effect", c.effect);
  a("where", c.where);
  a("p", c.p);
  a("group", c.group);
  a("parameters", c.parameters);
  a("bound_hit", c.bound_hit);
  a("held_out_gain", c.held_out_gain);
  a("screening_gain", c.screening_gain);
  a("note", c.note);
}

template <class A>
void Fields(A& a, typename A::template Ref<FamilyClosure> f) {
  a("family", f.family);
  a("runs", f.runs);
  a("before_m", f.before_m);
  a("after_m", f.after_m);
  a("floor_m", f.floor_m);
  a("closed", f.closed);
}

template <class A>
void Fields(A& a, typename A::template Ref<Confusion> c) {
  a("a", c.a);
  a("b", c.b);
  a("cosine", c.cosine);
  a("profile_gap", c.profile_gap);
  a("confirmed", c.confirmed);
}

template <class A>
void Fields(A& a, typename A::template Ref<Baseline> b) {
  a("name", b.name);
  a("effect", b.effect);
  a("where", b.where);
}

template <class A>
void Fields(A& a, typename A::template Ref<ConditionMap> m) {
  a("cut", m.cut);
  a("channel", m.channel);
  a("unit", m.unit);
  a("condition", m.condition);
  a("condition_unit", m.condition_unit);
  a("at", m.at);
  a("mean", m.mean);
  a("low", m.low);
  a("high", m.high);
  a("after", m.after);
}

template <class A>
void Fields(A& a, typename A::template Ref<Overlay> o) {
  a("run", o.run);
  a("channel", o.channel);
  a("unit", o.unit);
  a("cut", o.cut);
  a("floor", o.floor);
  a("time_s", o.time_s);
  a("measured", o.measured);
  a("before", o.before);
  a("after", o.after);
  a("against", o.against);
  a("against_unit", o.against_unit);
  a("x", o.x);
}

template <class A>
void Fields(A& a, typename A::template Ref<HorizonPoint> h) {
  a("horizon_s", h.horizon_s);
  a("rms_m", h.rms_m);
  a("floor_m", h.floor_m);
}

template <class A>
void Fields(A& a, typename A::template Ref<FreeRun> f) {
  a("run", f.run);
  a("family", f.family);
  a("duration_s", f.duration_s);
  a("moves_m", f.moves_m);
  a("before_m", f.before_m);
  a("after_m", f.after_m);
}

template <class A>
void Fields(A& a, typename A::template Ref<Profile> p) {
  a("effect", p.effect);
  a("where", p.where);
  a("parameter", p.parameter);
  a("value", p.value);
  a("score", p.score);
}

template <class A>
void Fields(A& a, typename A::template Ref<LearnedNumber> n) {
  a("key", n.key);
  a("in_file", n.in_file);
  a("value", n.value);
  a("moved", n.moved);
}

template <class A>
void Fields(A& a, typename A::template Ref<SuspectNumber> n) {
  a("key", n.key);
  a("in_file", n.in_file);
  a("value", n.value);
  a("closed", n.closed);
}

template <class A>
void Fields(A& a, typename A::template Ref<NextExperiment> n) {
  a("family", n.family);
  a("reason", n.reason);
  a("separation_sigma", n.separation_sigma);
  a("yaml", n.yaml);
  a("alternatives", n.alternatives);
}

template <class A>
void Fields(A& a, typename A::template Ref<Repeatability> r) {
  a("cut", r.cut);
  a("where", r.where);
  a("quantity", r.quantity);
  a("unit", r.unit);
  a("rms", r.rms);
  a("floor", r.floor);
  a("sigma", r.sigma);
  a("depends_on", r.depends_on);
  a("p_value", r.p_value);
  a("law", r.law);
}

template <class A>
void Fields(A& a, typename A::template Ref<HealthFinding> h) {
  a("severity", h.severity);
  a("run", h.run);
  a("channel", h.channel);
  a("value", h.value);
  a("text", h.text);
}

template <class A>
void Fields(A& a, typename A::template Ref<RunSummary> r) {
  a("name", r.name);
  a("family", r.family);
  a("repeat_of", r.repeat_of);
  a("sha256", r.sha256);
  a("duration_s", r.duration_s);
  a("rate_Hz", r.rate_Hz);
  a("samples", r.samples);
  a("before", r.before);
  a("before_sha256", r.before_sha256);
}

template <class A>
void Fields(A& a, typename A::template Ref<Diagnosis> d) {
  a("verdict", d.verdict);
  a("sentence", d.sentence);
  a("location", d.location);
  a("causes", d.causes);
  a("accepted", d.accepted);
  // "closed" combines several members: see WriteClosed and ReadClosed.
  a("order_effects", d.order_effects);
  a("leftover_sigma", d.leftover_sigma);
  a("learned", d.learned);
  a("suspected", d.suspected);
  a("doubt", d.doubt);
  a("confusable", d.confusable);
  a("baselines", d.baselines);
  a("condition_maps", d.maps);
  a("overlays", d.overlays);
  a("horizon", d.horizon);
  a("profiles", d.profiles);
  a("input_correlations", d.input_correlations);
  a("next_experiment", d.next);
  a("data_health", d.health);
  a("degradations", d.degradations);
}

template <class A>
void ProvenanceFields(A& a, typename A::template Ref<Diagnosis> d) {
  a("robot_name", d.robot_name);
  a("robot_yaml", d.robot_yaml);
  a("runs", d.runs);
  a("held_out_families", d.held_out_families);
  a("held_out_by", d.held_out_by);
  a("delta_N", d.delta_N);
  a("delta_m", d.delta_m);
  a("seed", d.seed);
  a("version", d.version);
  a("revision", d.revision);
  a("command", d.command);
  a("seconds", d.seconds);
}

}  // namespace tendril::gap
