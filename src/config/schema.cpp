// The lists of keys.h as nested objects. Draft 7, because the servers behind editors know it best. A block's
// properties and its required keys are apart: tendons that differ have the first without the second.
#include "tendril/config/schema.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

#include "tendril/config/keys.h"
#include "within.h"

namespace tendril::config {
namespace {

using Json = nlohmann::ordered_json;

std::string NameOf(const Key& key) { return key.path.substr(key.path.rfind('.') + 1); }

/// What may follow `within:`.
Json SchemaOfWithin() {
  return {
      {"description",
       "How well the value is known, as one standard deviation: a share of it (10 %), a number in "
       "its own unit, or known, or unknown."},
      {"anyOf",
       {{{"type", "number"}, {"exclusiveMinimum", 0}}, {{"type", "string"}, {"pattern", kWithinPattern}}}}};
}

/// Keys right below a block ("body", "body.sections[]"), with what they contain.
class Schema {
 public:
  /// `uncertain`: a number may say how well it is known.
  Schema(std::vector<Key> keys, bool uncertain) : keys_(std::move(keys)), uncertain_(uncertain) {}

  Json Whole(std::string_view title) const {
    Json schema{{"$schema", "http://json-schema.org/draft-07/schema#"}, {"title", title}};
    if (uncertain_) schema["definitions"]["within"] = SchemaOfWithin();
    schema.update(Object(""));
    schema.update(Requirements(""));
    return schema;
  }

 private:
  std::vector<const Key*> Below(std::string_view block) const;
  Json Object(const std::string& block) const;
  Json Requirements(const std::string& block) const;
  Json ValueOf(const Key& key) const;
  Json Tendons(const std::string& block) const;
  Json Single(const Key& key) const;
  Json NumberOrUncertain(Json number) const;

  std::vector<Key> keys_;
  bool uncertain_;
};

std::vector<const Key*> Schema::Below(std::string_view block) const {
  std::vector<const Key*> below;
  for (const Key& key : keys_) {
    const std::size_t dot = key.path.rfind('.');
    if (std::string_view(key.path).substr(0, dot == std::string::npos ? 0 : dot) == block)
      below.push_back(&key);
  }
  return below;
}

// Whole numbers without a decimal point: JSON tells 1 from 1.0 for whoever reads the schema.
Json NumberOf(double value) {
  if (value == std::floor(value) && std::abs(value) < 1e15) return static_cast<long long>(value);
  return value;
}

void Limit(Json& schema, Range range) {
  schema[range.above_min ? "exclusiveMinimum" : "minimum"] = NumberOf(range.min);
  schema["maximum"] = NumberOf(range.max);
}

/// The number, or the same number as `value` beside its `within`. Bounds of numbers say nothing of mappings,
/// and keys nothing of numbers, so both are in one.
Json Schema::NumberOrUncertain(Json number) const {
  if (!uncertain_) return number;
  Json either = number;
  either["type"] = {number["type"], "object"};
  either["properties"] = {{"value", std::move(number)}, {"within", {{"$ref", "#/definitions/within"}}}};
  either["required"] = {"value"};
  either["additionalProperties"] = false;
  return either;
}

/// One value, or one of a list of values, without its meaning.
Json Schema::Single(const Key& key) const {
  Json single;
  switch (key.type) {
    case Key::Type::kNumber:
    case Key::Type::kInteger:
      single["type"] = key.type == Key::Type::kNumber ? "number" : "integer";
      if (key.range) Limit(single, *key.range);
      for (const std::string& choice : key.choices) single["enum"].push_back(std::stoll(choice));
      // What needs no value where something is missing may be 0 there; Requirements has the other case.
      if (!key.needless.first.empty()) single["minimum"] = 0;
      return NumberOrUncertain(std::move(single));
    case Key::Type::kFlag:
      return {{"type", "boolean"}};
    case Key::Type::kChoice:
      single["type"] = "string";
      for (const std::string& choice : key.choices) single["enum"].push_back(choice);
      return single;
    case Key::Type::kText:
      single["type"] = "string";
      if (!key.pattern.empty()) single["pattern"] = key.pattern;
      return single;
  }
  return single;
}

std::string DescriptionOf(const Key& key) {
  std::string text = key.meaning;
  if (!key.accepted.empty())
    text += fmt::format(" Accepted: {}{}.", key.accepted, key.unit.empty() ? "" : " " + key.unit);
  if (key.otherwise) text += fmt::format(" Default: {}.", *key.otherwise);
  return text;
}

Json ListOf(Json items, const Key& key) {
  Json list{{"type", "array"}, {"items", std::move(items)}};
  list["minItems"] = NumberOf(key.count->min);
  list["maxItems"] = NumberOf(key.count->max);
  return list;
}

Json Schema::ValueOf(const Key& key) const {
  Json schema;
  switch (key.kind) {
    case Key::Kind::kValue:
      schema = key.count ? ListOf(Single(key), key) : Single(key);
      break;
    case Key::Kind::kBlock:
      schema = Object(key.path);
      break;
    case Key::Kind::kList: {
      Json items = Object(key.path + "[]");
      items.update(Requirements(key.path + "[]"));
      schema = ListOf(std::move(items), key);
      break;
    }
    case Key::Kind::kMapping:
      schema = Tendons(key.path.substr(0, key.path.rfind('.')));
      break;
  }
  schema["description"] = DescriptionOf(key);
  return schema;
}

/// Entries by number with the required blocks of `block`, of which nothing is required.
Json Schema::Tendons(const std::string& block) const {
  Json entry{{"type", "object"}, {"additionalProperties", false}};
  for (const Key* key : Below(block)) {
    if (key->kind == Key::Kind::kBlock && !key->otherwise) entry["properties"][NameOf(*key)] = ValueOf(*key);
  }
  return {{"type", "object"},
          {"patternProperties", {{"^[1-9][0-9]*$", std::move(entry)}}},
          {"additionalProperties", false}};
}

/// The properties of a block.
Json Schema::Object(const std::string& block) const {
  Json object{{"type", "object"}, {"properties", Json::object()}, {"additionalProperties", false}};
  for (const Key* key : Below(block)) {
    if (key->kind == Key::Kind::kMapping && key->range) {
      Json number{{"type", "number"}};
      Limit(number, *key->range);
      object["additionalProperties"] = NumberOrUncertain(std::move(number));
      object["additionalProperties"]["description"] = DescriptionOf(*key);
    } else {
      object["properties"][NameOf(*key)] = ValueOf(*key);
    }
  }
  return object;
}

/// One of two sets of keys: `key`, or those that it stands for.
Json Alternatives(const Key& key) {
  Json without = Json::object();
  for (const std::string& other : key.instead_of) without[other] = false;
  return {{{"required", {NameOf(key)}}, {"properties", without}}, {{"required", key.instead_of}}};
}

/// Keys that a block must have, and those of its blocks. Where some of it is given tendon by tendon, the
/// common blocks need not be complete.
Json Schema::Requirements(const std::string& block) const {
  Json required = Json::array(), properties = Json::object(), optional = Json::object(),
       rules = Json::object();
  const std::vector<const Key*> below = Below(block);
  const auto replaced = [&](const Key& key) {
    return std::any_of(below.begin(), below.end(), [&](const Key* other) {
      return std::count(other->instead_of.begin(), other->instead_of.end(), NameOf(key)) > 0;
    });
  };
  const Key* numbered = nullptr;
  Json needed;  // where `needless` does not hold
  const Key* missing = nullptr;
  for (const Key* key : below) {
    if (!key->instead_of.empty()) rules["oneOf"] = Alternatives(*key);
    if (key->kind == Key::Kind::kMapping && !key->range) numbered = key;
    if (!key->needless.first.empty()) {
      missing = key;
      needed["required"].push_back(NameOf(*key));
      const Json least{{"minimum", NumberOf(key->range->min)}};
      needed["properties"][NameOf(*key)] = least;
      if (uncertain_) needed["properties"][NameOf(*key)]["properties"]["value"] = least;
    } else if (!key->otherwise && !replaced(*key) && key->kind != Key::Kind::kMapping) {
      required.push_back(NameOf(*key));
    }
    if (key->kind == Key::Kind::kBlock) {
      if (Json inside = Requirements(key->path); !inside.empty())
        (key->otherwise ? optional : properties)[NameOf(*key)] = std::move(inside);
    }
  }
  if (missing != nullptr) {
    rules["if"] = {{"properties", {{missing->needless.first, {{"const", missing->needless.second}}}}}};
    rules["else"] = std::move(needed);
  }
  if (!required.empty()) rules["required"] = std::move(required);
  if (!properties.empty()) rules["allOf"] = {{{"properties", std::move(properties)}}};
  if (numbered != nullptr) {
    Json unless{{"if", {{"required", {NameOf(*numbered)}}}}, {"else", std::move(rules)}};
    rules = std::move(unless);
  }
  if (!optional.empty()) rules["allOf"].push_back({{"properties", std::move(optional)}});
  return rules;
}

}  // namespace

std::string RobotFileSchema() {
  return Schema(RobotFileKeys(), true).Whole("Tendril robot file").dump(2) + "\n";
}
std::string DaemonFileSchema() {
  return Schema(DaemonFileKeys(), false).Whole("Tendril daemon file").dump(2) + "\n";
}

}  // namespace tendril::config
