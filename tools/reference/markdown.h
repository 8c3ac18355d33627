// Markdown as the site reads it: text that is not ours, put so that it is shown as it is. Knows no page.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tendril::reference {

/// Text with nothing in it that Markdown or HTML would take for its own.
std::string Escaped(std::string_view text);
/// Escaped, and as code what the text has in backticks and names of keys, fields and files (with an
/// underscore).
std::string Prose(std::string_view text);
/// Prose that begins with a capital and ends with a full stop.
std::string Sentence(std::string_view text);
std::string Code(std::string_view text);
/// A name as the target of links: what may stand in an address.
std::string Anchor(std::string_view name);
/// Code that links lead to.
std::string Target(std::string_view name, std::string_view anchor);
/// "[`name`](file.md#anchor)".
std::string Link(std::string_view name, std::string_view file, std::string_view anchor);
/// In small print, below what stands before it in a cell.
std::string Below(std::string_view markdown);
std::string Heading(int level, std::string_view text, std::string_view anchor = {});

/// Cells are Markdown; a line of them each.
class Table {
 public:
  explicit Table(std::vector<std::string> head);
  void Row(const std::vector<std::string>& cells);
  bool empty() const { return rows_ == 0; }
  std::string Text() const { return text_ + "\n"; }

 private:
  std::string text_;
  int rows_ = 0;
};

/// The page's head: title, what it is, and what it is made from.
std::string Head(std::string_view title, std::string_view introduction,
                 const std::vector<std::string>& sources);

}  // namespace tendril::reference
