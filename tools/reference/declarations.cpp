#include "declarations.h"

#include <fmt/format.h>

#include <cctype>
#include <fstream>
#include <regex>
#include <stdexcept>

namespace tendril::reference {
namespace {

std::string Trimmed(std::string text) {
  const auto is_blank = [](char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; };
  while (!text.empty() && is_blank(text.back())) text.pop_back();
  while (!text.empty() && is_blank(text.front())) text.erase(text.begin());
  return text;
}

// A comment that begins farther right stands behind a member, or goes on below one that does.
constexpr std::size_t kBehind = 8;

/// A line apart: what the compiler reads, and the comment.
struct Line {
  std::string code{}, comment{};
  bool behind = false;  // the comment stands where those behind members do
  bool closes = false;  // ends a structure
};

Line Apart(const std::string& text) {
  const std::size_t at = text.find("//");
  if (at == text.npos) return {.code = Trimmed(text), .closes = text.starts_with("}")};
  const std::size_t begin = text.find_first_not_of('/', at);
  return {.code = Trimmed(text.substr(0, at)),
          .comment = begin == text.npos ? "" : Trimmed(text.substr(begin)),
          .behind = at > kBehind};
}

void Append(std::string& text, const std::string& more) {
  text += (text.empty() || more.empty() ? "" : " ") + more;
}

/// Reads line by line; a comment that stands alone belongs to what follows it.
class Parser {
 public:
  std::vector<Structure> Finished() { return std::move(structures_); }

  void Read(const std::string& text) {
    const Line line = Apart(text);
    static const std::regex kStruct(R"(struct (\w+)[^;]*\{)");
    std::smatch match;
    if (line.code.empty()) return ReadComment(line);
    if (std::regex_match(line.code, match, kStruct)) {
      structures_.push_back({match[1], alone_, {}});
      open_ = true;
      group_.clear();
      statement_.clear();
      comment_.clear();
    } else if (line.closes) {
      open_ = false;
    } else if (open_) {
      ReadMembers(line);
    }
    alone_.clear();
  }

 private:
  void ReadComment(const Line& line) {
    if (line.comment.empty()) {
      alone_.clear();
      group_.clear();
    } else if (open_ && line.behind && !structures_.back().members.empty()) {
      Append(structures_.back().members.back().comment, line.comment);
    } else {
      Append(alone_, line.comment);
      group_ = alone_;
    }
  }

  void ReadMembers(const Line& line) {
    Append(statement_, line.code);
    Append(comment_, line.comment);
    if (!line.code.ends_with(";")) return;
    Declare(statement_.substr(0, statement_.size() - 1), comment_);
    statement_.clear();
    comment_.clear();
  }

  /// "double low = 0, high = 0", "const int8_t ARM = 0", "double tip_W_m[3]".
  void Declare(std::string code, const std::string& comment) {
    static const std::regex kHead(R"((const )?((?:[\w:]+)(?:<.*>)?) (.*))");
    std::smatch head;
    if (code.find('(') != code.npos || !std::regex_match(code, head, kHead)) return;
    const bool constant = head[1].matched;
    const std::string type = head[2];
    if (type == "using" || type == "enum" || type == "static") return;
    static const std::regex kName(
        R"(\s*(\w+)(?:\[(\w+)\])?(?:\s*=\s*([^,{]+|\{[^}]*\}))?(?:\{[^}]*\})?\s*(?:,|$))");
    const std::string rest = head[3];
    for (std::sregex_iterator at(rest.begin(), rest.end(), kName), end; at != end; ++at) {
      structures_.back().members.push_back({.type = type,
                                            .name = (*at)[1],
                                            .extent = (*at)[2],
                                            .value = Trimmed((*at)[3]),
                                            .comment = comment,
                                            .constant = constant,
                                            .group = group_});
    }
  }

  std::vector<Structure> structures_;
  bool open_ = false;
  std::string alone_, group_;        // comments that stand alone
  std::string statement_, comment_;  // of members, until the semicolon
};

}  // namespace

std::vector<Structure> ReadDeclarations(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in)
    throw std::runtime_error(fmt::format("cannot read {}; name the folder of the repository", file.string()));
  Parser parser;
  for (std::string line; std::getline(in, line);) parser.Read(line);
  return parser.Finished();
}

std::string CommentOf(const std::vector<Structure>& structures, std::string_view member) {
  for (const Structure& structure : structures) {
    for (const Member& m : structure.members) {
      if (fmt::format("{}::{}", structure.name, m.name) == member)
        return m.comment.empty() ? m.group : m.comment;
    }
  }
  return "";
}

}  // namespace tendril::reference
