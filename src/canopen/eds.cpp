// An EDS file in two passes: lines to sections, sections to objects. Knows no drive.
#include "tendril/canopen/eds.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "tendril/core/plain_text.h"

namespace tendril::canopen {
namespace {

constexpr std::uintmax_t kLargestFile = 8u << 20;
constexpr int kMostSubIndices = 254;
// Makers' sheets have some hundreds to thousands; a damaged one could stand for millions.
constexpr std::size_t kMostObjects = 50'000;
constexpr std::string_view kNumber = "a whole number, as 16 or 0x10";

std::string Lower(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return lower;
}

std::string_view Trim(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

/// Text of the file as a message may show it.
std::string Shown(std::string_view text) { return PlainText(text, 40); }

// ---- lines to sections --------------------------------------------------------------------------

struct Value {
  std::string key, text;
  int line = 0;
};
struct Section {
  std::string name;
  int line = 0;
  std::map<std::string, Value> values;  // by the key in lower case
};

class File {
 public:
  File(const std::string& text, std::string name) : name_(std::move(name)) {
    constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
    std::string_view rest = text;
    if (rest.starts_with(kByteOrderMark)) rest.remove_prefix(kByteOrderMark.size());
    if (rest.find('\0') != rest.npos) Fail(1, "this is no text; accepted: an EDS file (CiA 306); name one");
    for (int line = 1; !rest.empty(); ++line) {
      const std::size_t end = rest.find('\n');
      AddLine(Trim(rest.substr(0, end)), line);
      rest.remove_prefix(end == rest.npos ? rest.size() : end + 1);
    }
  }

  [[noreturn]] void Fail(int line, const std::string& text) const {
    throw std::invalid_argument(name_ + ":" + std::to_string(line) + ": " + text);
  }
  const std::vector<Section>& sections() const { return sections_; }
  const Section* Find(const std::string& name) const {
    const auto at = by_name_.find(Lower(name));
    return at == by_name_.end() ? nullptr : &sections_[at->second];
  }
  const std::string& name() const { return name_; }

 private:
  void AddLine(std::string_view line, int number) {
    if (line.empty() || line.front() == ';' || line.front() == '#') return;
    if (line.front() == '[') {
      const std::size_t close = line.find(']');
      if (close == line.npos) {
        Fail(number, "section '" + Shown(line) + "' has no end; accepted: [NAME]; add the bracket");
      }
      Section section{.name = std::string(Trim(line.substr(1, close - 1))), .line = number, .values = {}};
      const auto [at, added] = by_name_.emplace(Lower(section.name), sections_.size());
      if (!added) {
        Fail(number, "section [" + Shown(section.name) + "] is in line " +
                         std::to_string(sections_[at->second].line) +
                         " already; accepted: every section once; remove one");
      }
      sections_.push_back(std::move(section));
      return;
    }
    const std::size_t equals = line.find('=');
    if (equals == line.npos || equals == 0 || sections_.empty()) {
      Fail(number,
           "'" + Shown(line) + "' is " +
               (sections_.empty() ? "before the first section" : "neither a section nor KEY=VALUE") +
               "; accepted: [SECTION], KEY=VALUE within one, or a comment after ';'; correct the line");
    }
    const std::string key(Trim(line.substr(0, equals)));
    Value value{key, std::string(Trim(line.substr(equals + 1))), number};
    if (!sections_.back().values.emplace(Lower(key), std::move(value)).second) {
      Fail(number, Shown(key) + " is in this section already; accepted: every key once; remove one");
    }
  }

  std::string name_;
  std::vector<Section> sections_;
  std::map<std::string, std::size_t> by_name_;
};

// ---- numbers ------------------------------------------------------------------------------------

/// As in C: hexadecimal after 0x, octal after 0, else decimal. False when it is none.
bool ToNumber(std::string_view text, std::int64_t* number) {
  bool negative = false;
  if (!text.empty() && (text.front() == '-' || text.front() == '+')) {
    negative = text.front() == '-';
    text.remove_prefix(1);
  }
  int base = 10;
  if (text.size() > 2 && text[0] == '0' && (text[1] == 'x' || text[1] == 'X')) {
    base = 16;
    text.remove_prefix(2);
  } else if (text.size() > 1 && text[0] == '0') {
    base = 8;
  }
  std::uint64_t magnitude = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), magnitude, base);
  if (error != std::errc() || end != text.data() + text.size() || text.empty() || magnitude >> 62 != 0) {
    return false;
  }
  *number = negative ? -static_cast<std::int64_t>(magnitude) : static_cast<std::int64_t>(magnitude);
  return true;
}

/// "$NODEID+0x180", "0x180 + $NODEID", "$NODEID", or a plain number.
bool ToNumber(std::string_view text, std::int64_t* number, bool* plus_node_id) {
  constexpr std::string_view kNodeId = "$nodeid";
  const std::string lower = Lower(text);
  const std::size_t at = lower.find(kNodeId);
  *plus_node_id = at != std::string::npos;
  if (!*plus_node_id) return ToNumber(text, number);
  *number = 0;
  std::string_view before = Trim(text.substr(0, at)), after = Trim(text.substr(at + kNodeId.size()));
  if (before.empty() && after.empty()) return true;
  if (before.empty() == after.empty()) return false;
  std::string_view& rest = before.empty() ? after : before;
  const bool plus = before.empty() ? rest.front() == '+' : rest.back() == '+';
  if (!plus) return false;
  before.empty() ? rest.remove_prefix(1) : rest.remove_suffix(1);
  return ToNumber(Trim(rest), number);
}

/// What stands before a comment at the line's end.
std::string_view WithoutComment(const std::string& text) {
  return Trim(std::string_view(text).substr(0, text.find(';')));
}

// ---- sections to objects ------------------------------------------------------------------------

DataType TypeOf(std::int64_t code) {
  switch (code) {
    case 0x2:
      return DataType::kI8;
    case 0x3:
      return DataType::kI16;
    case 0x4:
      return DataType::kI32;
    case 0x1:  // boolean
    case 0x5:
      return DataType::kU8;
    case 0x6:
      return DataType::kU16;
    case 0x7:
      return DataType::kU32;
    case 0x9:
    case 0xA:
    case 0xB:
      return DataType::kString;
    default:
      return DataType::kOther;
  }
}

std::string Hex(std::uint32_t value, int digits) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%0*X", digits, value);
  return text.data();
}

/// True for the name of an object's section: "6040", or with a sub-index "1018sub1".
bool IsObject(std::string_view name, ObjectAddress* address, bool* has_sub) {
  constexpr std::string_view kSub = "sub";
  if (name.size() < 4) return false;
  std::uint32_t index = 0, sub = 0;
  const auto read = [](std::string_view digits, std::uint32_t* value) {
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), *value, 16);
    return error == std::errc() && end == digits.data() + digits.size();
  };
  if (!read(name.substr(0, 4), &index)) return false;
  const std::string_view rest = name.substr(4);
  *has_sub = !rest.empty();
  if (*has_sub && (!rest.starts_with(kSub) || rest.size() > 5 || !read(rest.substr(3), &sub))) return false;
  *address = {static_cast<std::uint16_t>(index), static_cast<std::uint8_t>(sub)};
  return true;
}

class Parser {
 public:
  explicit Parser(const File& file) : file_(file) { eds_.file = file.name(); }

  Eds Parse() {
    ReadDeviceInfo();
    for (const Section& section : file_.sections()) {
      ObjectAddress address;
      bool has_sub = false;
      if (IsObject(Lower(section.name), &address, &has_sub)) ReadObject(section, address, has_sub);
    }
    CheckLists();
    CheckOnce();
    eds_.objects.Sort();
    return std::move(eds_);
  }

 private:
  const Value* Find(const Section& section, const std::string& key) const {
    const auto at = section.values.find(key);
    return at == section.values.end() || WithoutComment(at->second.text).empty() ? nullptr : &at->second;
  }
  [[noreturn]] void Refuse(const Section& section, const Value& value, const std::string& accepted) const {
    file_.Fail(value.line, "[" + Shown(section.name) + "] " + Shown(value.key) + " is '" + Shown(value.text) +
                               "'; accepted: " + accepted + "; correct it");
  }
  /// `otherwise` where the section lacks the key, or says nothing after it.
  std::int64_t Number(const Section& section, const std::string& key, std::int64_t otherwise,
                      std::int64_t max = 0xFFFFFFFF) const {
    const Value* value = Find(section, key);
    if (value == nullptr) return otherwise;
    std::int64_t number = 0;
    if (!ToNumber(WithoutComment(value->text), &number) || number < 0 || number > max) {
      Refuse(section, *value, std::string(kNumber) + ", at most " + std::to_string(max));
    }
    return number;
  }

  void ReadDeviceInfo() {
    const Section* info = file_.Find("deviceinfo");
    if (info == nullptr) {
      file_.Fail(1, "no section [DeviceInfo]; accepted: an EDS file (CiA 306); name one");
    }
    const auto text = [&](const std::string& key) {
      const Value* value = Find(*info, key);
      return value == nullptr ? std::string() : Shown(value->text);
    };
    eds_.vendor_name = text("vendorname");
    eds_.product_name = text("productname");
    if (const auto vendor = Number(*info, "vendornumber", 0))
      eds_.vendor = static_cast<std::uint32_t>(vendor);
    if (const auto product = Number(*info, "productnumber", 0))
      eds_.product = static_cast<std::uint32_t>(product);
  }

  void ReadObject(const Section& section, ObjectAddress address, bool has_sub) {
    const std::string index = Hex(address.index, 4);
    if (has_sub) {
      if (file_.Find(index) == nullptr) {
        file_.Fail(section.line, "[" + section.name + "] belongs to no object; accepted: a section [" +
                                     index + "] beside it; add it");
      }
      Add(section, address, Name(section));
      return;
    }
    if (const std::int64_t count = Number(section, "compactsubobj", 0, kMostSubIndices); count > 0) {
      AddCompact(section, address.index, static_cast<int>(count));
      return;
    }
    // A record, array or structure is made of its sub-indices; any other object has its value itself.
    const std::int64_t kind = Number(section, "objecttype", 0x7, 0xFF);
    if (Number(section, "subnumber", 0, 0xFF) > 0) return;
    if (kind == 0x7 || kind == 0x2) Add(section, address, Name(section));
  }

  const char* Name(const Section& section) {
    const Value* value = Find(section, "parametername");
    return value == nullptr ? "" : eds_.objects.Keep(Shown(value->text));
  }

  /// Sub-indices that are all alike, with their default values in a section of their own.
  void AddCompact(const Section& section, std::uint16_t index, int count) {
    ObjectEntry& number = eds_.objects.Add({index, 0}, DataType::kU8, Access::kReadOnly, Name(section));
    number.default_value = count;
    number.states_default = true;
    number.line = section.line;
    const Section* values = file_.Find(section.name + "Value");
    for (int sub = 1; sub <= count; ++sub) {
      ObjectEntry& entry = Add(section, {index, static_cast<std::uint8_t>(sub)}, Name(section));
      if (const Value* value = values == nullptr ? nullptr : Find(*values, std::to_string(sub)))
        SetDefault(*values, *value, entry);
    }
  }

  ObjectEntry& Add(const Section& section, ObjectAddress address, const char* name) {
    if (Find(section, "datatype") == nullptr && Number(section, "objecttype", 0x7, 0xFF) == 0x7) {
      file_.Fail(section.line, "[" + section.name + "] has no DataType; accepted: one, as 0x0007; add it");
    }
    const DataType type = TypeOf(Number(section, "datatype", 0xF, 0xFFFF));
    if (eds_.objects.entries().size() >= kMostObjects) {
      file_.Fail(section.line, "more than " + std::to_string(kMostObjects) +
                                   " objects; accepted: fewer; name the maker's sheet of one drive");
    }
    ObjectEntry& entry = eds_.objects.Add(address, type, Access::kReadOnly, name);
    entry.line = section.line;
    SetAccess(section, entry);
    if (type == DataType::kString) {
      const Value* value = Find(section, "defaultvalue");
      entry.text = value == nullptr ? "" : eds_.objects.Keep(value->text);
    }
    if (TypeBytes(type) == 0) return entry;
    if (const Value* value = Find(section, "defaultvalue")) SetDefault(section, *value, entry);
    SetLimit(section, "lowlimit", type, &entry.min);
    SetLimit(section, "highlimit", type, &entry.max);
    if (entry.min > entry.max) {
      file_.Fail(section.line, "[" + section.name +
                                   "] has a LowLimit above its HighLimit; accepted: at most "
                                   "that; correct the one or the other");
    }
    return entry;
  }

  void SetAccess(const Section& section, ObjectEntry& entry) {
    static const std::map<std::string, std::pair<Access, Mapping>> kAccess = {
        {"const", {Access::kConst, Mapping::kTransmit}},   {"ro", {Access::kReadOnly, Mapping::kTransmit}},
        {"wo", {Access::kWriteOnly, Mapping::kReceive}},   {"rw", {Access::kReadWrite, Mapping::kBoth}},
        {"rwr", {Access::kReadWrite, Mapping::kTransmit}}, {"rww", {Access::kReadWrite, Mapping::kReceive}}};
    const Value* value = Find(section, "accesstype");
    if (value == nullptr) {
      if (entry.type == DataType::kOther) return;
      file_.Fail(section.line, "[" + section.name +
                                   "] has no AccessType; accepted: ro, wo, rw, rwr, rww or "
                                   "const; add it");
    }
    const auto access = kAccess.find(Lower(WithoutComment(value->text)));
    if (access == kAccess.end()) Refuse(section, *value, "ro, wo, rw, rwr, rww or const");
    entry.access = access->second.first;
    if (Number(section, "pdomapping", 0, 1) == 1) entry.mapping = access->second.second;
  }

  /// A number within its type; a signed type also takes its bit pattern, as 0xFFFF for -1.
  std::int64_t OfType(const Section& section, const Value& value, DataType type, bool* plus_node_id) const {
    std::int64_t number = 0;
    const bool known = ToNumber(WithoutComment(value.text), &number, plus_node_id);
    const std::int64_t all_bits = (std::int64_t{1} << (8 * TypeBytes(type))) - 1;
    if (known && TypeSigned(type) && number > TypeMax(type) && number <= all_bits) number -= all_bits + 1;
    if (!known || number < TypeMin(type) || number > TypeMax(type)) {
      Refuse(section, value,
             known ? std::to_string(TypeMin(type)) + " .. " + std::to_string(TypeMax(type)) +
                         ", its DataType's range"
                   : std::string(kNumber) + ", or $NODEID+NUMBER");
    }
    return number;
  }
  void SetDefault(const Section& section, const Value& value, ObjectEntry& entry) {
    if (TypeBytes(entry.type) == 0) return;
    entry.default_value = OfType(section, value, entry.type, &entry.plus_node_id);
    entry.states_default = true;
  }
  /// Limits that count from the node id bound nothing here.
  void SetLimit(const Section& section, const std::string& key, DataType type, std::int64_t* limit) const {
    const Value* value = Find(section, key);
    if (value == nullptr) return;
    bool plus_node_id = false;
    const std::int64_t number = OfType(section, *value, type, &plus_node_id);
    if (!plus_node_id) *limit = number;
  }

  /// Every object of the lists has its section: a file that was cut off is found out here.
  void CheckLists() const {
    if (file_.Find("mandatoryobjects") == nullptr) {
      file_.Fail(1, "no section [MandatoryObjects]; accepted: an EDS file (CiA 306); name one");
    }
    for (const char* name : {"mandatoryobjects", "optionalobjects", "manufacturerobjects"}) {
      const Section* list = file_.Find(name);
      if (list == nullptr) continue;
      const std::int64_t count = Number(*list, "supportedobjects", 0, 0xFFFF);
      for (std::int64_t i = 1; i <= count; ++i) {
        const std::string key = std::to_string(i);
        const Value* value = Find(*list, key);
        if (value == nullptr) {
          file_.Fail(list->line, "[" + list->name + "] says SupportedObjects=" + std::to_string(count) +
                                     " and lists no " + key + "; accepted: a line for each; correct it");
        }
        const std::string index = Hex(static_cast<std::uint32_t>(Number(*list, key, 0, 0xFFFF)), 4);
        if (file_.Find(index) == nullptr) {
          file_.Fail(value->line, "[" + list->name + "] lists 0x" + index +
                                      ", which has no section; accepted: a section [" + index +
                                      "]; take the whole file, or remove the line");
        }
      }
    }
  }

  /// Two sections can be of one object, as [1018sub1] and [1018sub01], or one beside a CompactSubObj.
  void CheckOnce() const {
    std::map<std::pair<int, int>, int> line_of;
    for (const ObjectEntry& entry : eds_.objects.entries()) {
      const auto [at, added] = line_of.emplace(std::pair<int, int>(entry.index, entry.sub), entry.line);
      if (added) continue;
      file_.Fail(entry.line, "object 0x" + Hex(entry.index, 4) + ":" + Hex(entry.sub, 2) + " is in line " +
                                 std::to_string(at->second) +
                                 " already; accepted: every object once; remove one");
    }
  }

  const File& file_;
  Eds eds_;
};

}  // namespace

Eds ParseEds(const std::string& text, const std::string& name_for_errors) {
  return Parser(File(text, name_for_errors)).Parse();
}

Eds ReadEds(const std::string& path) {
  namespace fs = std::filesystem;
  const auto refuse = [&path](const char* why) {
    throw std::invalid_argument(path + ": " + why + "; accepted: an EDS file (CiA 306); name one");
  };
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) refuse("no such file, or it cannot be reached");
  if (!fs::is_regular_file(status)) refuse("is not an ordinary file");
  if (fs::file_size(path, error) > kLargestFile) refuse("is larger than 8 MiB, or cannot be read");
  std::ifstream in(path, std::ios::binary);
  std::string text;
  if (in) text.assign(std::istreambuf_iterator<char>(in), {});
  if (text.empty()) refuse("cannot be read, or is empty");
  return ParseEds(text, path);
}

}  // namespace tendril::canopen
