// The line that shows how far long work is. Knows nothing of the work.
#include "progress.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <thread>
#include <vector>

namespace tendril::tools {
namespace {

using testing::HasSubstr;
using testing::Not;

// What is written, and a clock that the test turns.
struct Shown {
  char* text = nullptr;
  std::size_t size = 0;
  std::FILE* file = open_memstream(&text, &size);
  double now_s = 100;

  ~Shown() {
    std::fclose(file);
    std::free(text);
  }
  Progress::Clock Clock() {
    return [this] { return now_s; };
  }
  std::string Text() {
    std::fflush(file);
    return {text, size};
  }
};

TEST(Progress, StaysQuietWhenTheWorkIsShort) {
  Shown shown;
  {
    Progress progress(shown.file, true, shown.Clock());
    for (int i = 0; i <= 10; ++i) {
      shown.now_s += 0.05;
      progress("reading", 0.1 * i);
    }
  }
  EXPECT_EQ(shown.Text(), "");
}

TEST(Progress, RedrawsOneLineOnATerminalAndEndsEachStage) {
  Shown shown;
  {
    Progress progress(shown.file, true, shown.Clock());
    for (int i = 0; i <= 100; ++i) {
      shown.now_s += 0.2;
      progress("screening", 0.01 * i);
    }
    progress("refits", 0);
    shown.now_s += 1;
    progress("refits", 0.5);
  }
  const std::string text = shown.Text();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 3) << "one a stage, and the time by stage";
  EXPECT_THAT(text, testing::ContainsRegex("\r  screening +50 %  +10 s, 10 s to go"));
  EXPECT_THAT(text, testing::ContainsRegex("screening +100 %[^\r]*\n"));
  EXPECT_EQ(text.back(), '\n');
}

TEST(Progress, WritesTheTimeByStageAtTheEnd) {
  Shown shown;
  {
    Progress progress(shown.file, false, shown.Clock());
    const auto work = [&](const char* stage, double seconds) {
      progress(stage, 0);
      shown.now_s += seconds;
      progress(stage, 1);
    };
    work("reading", 0.02);
    work("screening", 7);
    work("refits", 2);
    work("screening", 1.5);
  }
  EXPECT_THAT(shown.Text(), testing::EndsWith("  10.5 s: screening 8.5 s, refits 2.0 s\n"));
}

TEST(Progress, WritesALineNowAndThenElsewhere) {
  Shown shown;
  {
    Progress progress(shown.file, false, shown.Clock());
    for (int i = 0; i < 600; ++i) {
      shown.now_s += 0.1;
      progress("refits", i / 600.0);
    }
  }
  const std::string text = shown.Text();
  EXPECT_THAT(text, Not(HasSubstr("\r")));
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
  const auto lines = std::count(text.begin(), text.end(), '\n');
  EXPECT_GE(lines, 8);
  EXPECT_LE(lines, 14);
}

TEST(Progress, NeverFallsBackNorLeavesItsRange) {
  Shown shown;
  {
    Progress progress(shown.file, true, shown.Clock());
    for (const double share : {0.5, 0.2, std::nan(""), 7.0}) {
      shown.now_s += 2;
      progress("x", share);
    }
  }
  const std::string text = shown.Text();
  EXPECT_THAT(text, Not(HasSubstr(" 20 %")));
  EXPECT_THAT(text, Not(HasSubstr("nan")));
  EXPECT_THAT(text, Not(HasSubstr("700 %")));
}

TEST(Progress, MayBeCalledFromSeveralThreads) {
  Shown shown;
  {
    Progress progress(shown.file, false, [] { return 0.0; });
    std::vector<std::jthread> threads;
    for (int k = 0; k < 4; ++k) {
      threads.emplace_back([&] {
        for (int i = 0; i < 1000; ++i) progress("x", 1e-3 * i);
      });
    }
  }
  EXPECT_EQ(shown.Text(), "");
}

}  // namespace
}  // namespace tendril::tools
