// watch_and_move URL [X_M Y_M Z_M]: prints the state of a running daemon ten times a second for five seconds;
// with a tip position it commands that first. The robot has to be armed: tendril send arm.
#include <chrono>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <tendril_lcm/state_t.hpp>

#include "tendril/io/client.h"

int main(int argc, char** argv) try {
  if (argc != 2 && argc != 5) {
    std::cerr << "usage: watch_and_move URL [X_M Y_M Z_M]\n";
    return 2;
  }
  using Clock = std::chrono::steady_clock;
  tendril::io::Client client(argv[1], "TENDRIL");
  int seen = 0;
  Clock::time_point printed;
  client.OnState([&](const tendril_lcm::state_t& state) {
    ++seen;
    if (Clock::now() - printed < std::chrono::milliseconds(100)) return;
    printed = Clock::now();
    std::cout << state.mode_text << ", tip [mm]:";
    for (const double x_m : state.tip_estimate_W_m) std::cout << ' ' << 1e3 * x_m;
    if (state.status != 0) std::cout << ", status " << state.status << ": " << state.status_text;
    std::cout << '\n';
  });
  if (argc == 5) {
    tendril::Command command;
    command.kind = tendril::CommandKind::kTip;
    command.valid_for_ns = 5 * tendril::kNsPerS;
    for (int i = 0; i < 3; ++i) command.tip_W_m[i] = std::atof(argv[2 + i]);
    tendril::io::Publish(client, command, argv[1]);
  }
  for (const auto end = Clock::now() + std::chrono::seconds(5); Clock::now() < end;) client.Handle(100);
  if (seen > 0) return 0;
  std::cerr << "no daemon was heard on " << argv[1] << '\n';
  return 1;
} catch (const std::exception& e) {
  std::cerr << e.what() << '\n';
  return 1;
}
