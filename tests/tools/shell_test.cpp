// Commands that are printed can be pasted.
#include "shell.h"

#include <gtest/gtest.h>

namespace tendril::tools {
namespace {

TEST(Shell, PlainWordsStayAndOthersAreQuoted) {
  EXPECT_EQ(ShellWord("out/gap-2_b.yaml"), "out/gap-2_b.yaml");
  EXPECT_EQ(ShellWord("where=tendon:2,3%+@"), "where=tendon:2,3%+@");
  EXPECT_EQ(ShellWord(""), "''");
  EXPECT_EQ(ShellWord("two words"), "'two words'");
  EXPECT_EQ(ShellWord("$(x) & \"y\""), "'$(x) & \"y\"'");
  EXPECT_EQ(ShellWord("it's"), "'it'\\''s'");
}

TEST(Shell, TheCommandBeginsWithTheProgramsNameWhereverItLies) {
  EXPECT_TRUE((CommandAsGiven("tendril") + " ").starts_with("tendril "));
}

}  // namespace
}  // namespace tendril::tools
