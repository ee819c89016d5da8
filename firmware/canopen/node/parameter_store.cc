#include "firmware/canopen/node/parameter_store.h"

#include "firmware/core/crypto/crc32.h"

namespace armtrue::canopen {
namespace {

using Block = std::array<std::uint8_t, kParameterBlockSize>;
constexpr std::size_t kCrcAt = kParameterBlockSize - 4;

}  // namespace

bool save_parameters(const ObjectDictionary& dictionary, ParameterStore& store) {
  Block block = {};
  store_le(block.data(), od::kLayoutFingerprint);
  dictionary.pack_stored(std::span(block).subspan(4, od::kStoredSize));
  store_le(&block[kCrcAt], crc32(std::span(block).first(kCrcAt)));
  return store.save(block);
}

Loaded load_parameters(ObjectDictionary& dictionary, ParameterStore& store,
                       std::uint32_t end_index) {
  Block block = {};
  if (!store.load(block)) return store.holds_something() ? Loaded::kDamaged : Loaded::kNone;
  if (load_le<std::uint32_t>(&block[kCrcAt]) != crc32(std::span(block).first(kCrcAt))) {
    return Loaded::kDamaged;
  }
  if (load_le<std::uint32_t>(block.data()) != od::kLayoutFingerprint) return Loaded::kOther;
  dictionary.unpack_stored(std::span(block).subspan(4, od::kStoredSize), end_index);
  return Loaded::kParameters;
}

}  // namespace armtrue::canopen
