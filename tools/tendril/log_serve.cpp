// `tendril log serve`: a running daemon's messages for Foxglove, by the Python package. Knows nothing of how.
#include <fmt/format.h>

#include <memory>
#include <string>
#include <vector>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "python_program.h"

namespace tendril::tools {
namespace {

struct ServeOptions {
  LcmOptions lcm;
  std::string address = "127.0.0.1";
  int port = 8765;
  std::vector<std::string> origins, hosts;
  double duration_s = 0;
};

void Serve(const ServeOptions& o) {
  std::vector<std::string> words{"--lcm",      o.lcm.url,
                                 "--prefix",   o.lcm.prefix,
                                 "--address",  o.address,
                                 "--port",     fmt::format("{}", o.port),
                                 "--duration", fmt::format("{}", o.duration_s)};
  for (const std::string& origin : o.origins) words.insert(words.end(), {"--origin", origin});
  for (const std::string& host : o.hosts) words.insert(words.end(), {"--host", host});
  RunPython("tendril.serve", words, {"foxglove", "foxglove_schemas_protobuf", "lcm"});
}

}  // namespace

void AddLogServeCommand(CLI::App& app) {
  auto o = std::make_shared<ServeOptions>();
  CLI::App* serve = LogCommand(app).add_subcommand("serve",
                                                   "What a running daemon publishes, live for Foxglove (its "
                                                   "WebSocket protocol); sends nothing to a robot");
  AddLcmOptions(*serve, o->lcm);
  serve->add_option("--port", o->port, "of the address; 0: any that is free")
      ->capture_default_str()
      ->check(CLI::Range(0, 65535));
  serve
      ->add_option(
          "--address", o->address,
          "where it is served; any but a loopback address lets every machine that reaches it read along")
      ->capture_default_str()
      ->option_text("ADDRESS");
  serve->add_option("--host", o->hosts, "name by which viewers reach it, besides localhost and the address")
      ->option_text("NAME")
      ->allow_extra_args(false);
  serve
      ->add_option(
          "--origin", o->origins,
          "web page that may read along, besides https://app.foxglove.dev and desktop programs; several: "
          "several times")
      ->option_text("ORIGIN")
      ->allow_extra_args(false);
  serve->add_option("--duration", o->duration_s, "end after this long [s]; 0: on Ctrl-C")
      ->capture_default_str()
      ->check(NumberFrom(0, 1e6, "give seconds"));
  serve->callback([o] { Serve(*o); });
}

}  // namespace tendril::tools
