// A file as exactly one YAML document holding a mapping; see the header.
#include "document.h"

#include <fmt/format.h>
#include <yaml-cpp/eventhandler.h>

#include <sstream>
#include <vector>

namespace tendril::config {
namespace {

/// Records where documents begin.
class DocumentStarts : public YAML::EventHandler {
 public:
  std::vector<int> lines;

  void OnDocumentStart(const YAML::Mark& mark) override { lines.push_back(mark.line + 1); }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
  void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t, const std::string&) override {}
  void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t, YAML::EmitterStyle::value) override {
  }
  void OnMapEnd() override {}
};

/// Lines of the first two documents. YAML::LoadAll is not used: after a stray comma yaml-cpp begins documents
/// without end.
std::vector<int> DocumentLines(const std::string& yaml) {
  std::istringstream in(yaml);
  YAML::Parser parser(in);
  DocumentStarts starts;
  while (starts.lines.size() < 2 && parser.HandleNextDocument(starts)) {
  }
  return starts.lines;
}

}  // namespace

std::string Printable(std::string_view text) {
  constexpr std::size_t kLongest = 48;
  std::string out;
  for (const char c : text.substr(0, kLongest)) out += static_cast<unsigned char>(c) < 0x20 ? '?' : c;
  if (text.size() > kLongest) out += "...";
  return out;
}

std::string_view TypeName(const YAML::Node& node) {
  switch (node.Type()) {
    case YAML::NodeType::Sequence:
      return "a list";
    case YAML::NodeType::Map:
      return "a mapping";
    case YAML::NodeType::Scalar:
      return node.Tag() == "!" ? "text in quotes" : "a single value";
    default:
      return "nothing";
  }
}

Layer ParseDocument(const std::string& yaml, const Source& source, std::string_view expected) {
  std::vector<int> documents;
  YAML::Node document;
  try {
    documents = DocumentLines(yaml);
    document = YAML::Load(yaml);
  } catch (const YAML::Exception& e) {
    throw ConfigError(
        fmt::format("{}:{}: not valid YAML: {}; accepted: {}; correct the line, or the one before it",
                    source.name, e.mark.is_null() ? 1 : e.mark.line + 1, Printable(e.msg), expected));
  }
  if (documents.empty() || (documents.size() == 1 && document.IsNull())) {
    throw ConfigError(fmt::format("{}:1: the file is empty; accepted: {}; start from one in config/",
                                  source.name, expected));
  }
  if (documents.size() > 1) {
    throw ConfigError(fmt::format("{}:{}: a second YAML document; accepted: {}, one to a file; remove it",
                                  source.name, documents[1], expected));
  }
  if (!document.IsMap()) {
    throw ConfigError(fmt::format(
        "{}:{}: the file contains {}, not keys with values; accepted: {}; start from one in config/",
        source.name, LineOf(document), TypeName(document), expected));
  }
  return {document, "", LineOf(document)};
}

}  // namespace tendril::config
