// Steps of a start-up that are alike in every drive. Knows CiA 301 and 402, no maker's objects.
#include "script.h"

namespace tendril::canopen {

using Kind = BootAction::Kind;

void Remap(Script& s, const PdoLayout& pdo, int node_id, const ObjectTable& objects) {
  const std::uint32_t cob_id =
      pdo.transmit ? kPdoNoRtr | TpdoCobId(pdo.number, node_id) : RpdoCobId(pdo.number, node_id);
  s.Step("PDO mapping");
  s.Add(Kind::kDisablePdo, pdo.communication_index(), 1);
  s.Write(pdo.communication_index(), 2, pdo.transmission);
  const auto has = [&](std::uint8_t sub) {
    const ObjectEntry* entry = objects.Find({pdo.communication_index(), sub});
    return entry != nullptr && entry->access == Access::kReadWrite;
  };
  if (pdo.transmit && has(3)) s.Write(pdo.communication_index(), 3, pdo.inhibit_100us);
  if (pdo.transmit && has(5)) s.Write(pdo.communication_index(), 5, 0);  // no event timer
  s.Write(pdo.mapping_index(), 0, 0);
  for (int i = 0; i < pdo.count; ++i) {
    s.Write(pdo.mapping_index(), static_cast<std::uint8_t>(i + 1),
            MappingValue(pdo.entries[static_cast<std::size_t>(i)]));
  }
  s.Write(pdo.mapping_index(), 0, pdo.count);
  s.Write(pdo.communication_index(), 1, cob_id);
}

void SetTorqueMode(Script& s) {
  s.Step("mode");
  s.Write(0x6060, 0, kModeCyclicSynchronousTorque);
  s.Add(Kind::kConfirm, 0x6061, 0, kModeCyclicSynchronousTorque);
}

void StartAndReadState(Script& s, const ObjectTable& objects) {
  s.Step("NMT start");
  s.Add(Kind::kStart, 0x1800, 1);
  s.Step("state");
  if (objects.Find({0x603F, 0}) != nullptr) s.Add(Kind::kNote, 0x603F, 0);
  s.Add(Kind::kNote, 0x6041, 0);
}

}  // namespace tendril::canopen
