#include "markdown.h"

#include <fmt/format.h>

#include <cctype>

namespace tendril::reference {
namespace {

bool OfName(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '.' || c == '[' || c == ']' ||
         c == '/';
}

/// The name at the beginning of the text, without a full stop that ends the sentence.
std::string_view NameAt(std::string_view text) {
  std::size_t end = 0;
  while (end < text.size() && OfName(text[end])) ++end;
  while (end > 0 && text[end - 1] == '.') --end;
  return text.substr(0, end);
}

}  // namespace

std::string Escaped(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else if (c == '&') {
      out += "&amp;";
    } else if (c == '|') {
      out += "&#124;";
    } else if (c == '\n') {
      out += ' ';
    } else {
      if (std::string_view("*_`[]{}\\#").find(c) != std::string_view::npos) out += '\\';
      out += c;
    }
  }
  return out;
}

std::string Prose(std::string_view text) {
  std::string out;
  while (!text.empty()) {
    if (const std::size_t end = text.find('`', 1); text.front() == '`' && end != text.npos) {
      out += text.substr(0, end + 1);
      text.remove_prefix(end + 1);
      continue;
    }
    const std::string_view name = NameAt(text);
    const std::size_t length = name.empty() ? 1 : name.size();
    const bool is_code = name.find('_') != std::string_view::npos && name.front() != '[';
    out += is_code ? Code(name) : Escaped(text.substr(0, length));
    text.remove_prefix(length);
  }
  return out;
}

std::string Sentence(std::string_view text) {
  std::string out = Prose(text);
  if (!out.empty()) out[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(out[0])));
  return out.ends_with('.') ? out : out + ".";
}

std::string Code(std::string_view text) { return fmt::format("`{}`", text); }

std::string Anchor(std::string_view name) {
  std::string anchor;
  for (const char c : name) {
    if (c == '[' || c == ']') continue;
    anchor += std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '.' || c == '-' ? c : '-';
  }
  return anchor;
}

std::string Target(std::string_view name, std::string_view anchor) {
  return fmt::format("{}{{ #{} }}", Code(name), Anchor(anchor));
}

std::string Link(std::string_view name, std::string_view file, std::string_view anchor) {
  return fmt::format("[{}]({}#{})", Code(name), file, Anchor(anchor));
}

std::string Below(std::string_view markdown) { return fmt::format("<br><small>{}</small>", markdown); }

std::string Heading(int level, std::string_view text, std::string_view anchor) {
  const std::string target = anchor.empty() ? "" : fmt::format(" {{ #{} }}", Anchor(anchor));
  return fmt::format("{} {}{}\n\n", std::string(static_cast<std::size_t>(level), '#'), text, target);
}

Table::Table(std::vector<std::string> head) {
  Row(head);
  for (std::string& cell : head) cell = "---";
  Row(head);
  rows_ = 0;
}

void Table::Row(const std::vector<std::string>& cells) {
  text_ += fmt::format("| {} |\n", fmt::join(cells, " | "));
  ++rows_;
}

std::string Head(std::string_view title, std::string_view introduction,
                 const std::vector<std::string>& sources) {
  std::string from;
  for (const std::string& source : sources) from += (from.empty() ? "" : ", ") + Code(source);
  return fmt::format("# {}\n\n{}\n\n*Generated from {} by `tools/docs`.*\n\n", title, introduction, from);
}

}  // namespace tendril::reference
