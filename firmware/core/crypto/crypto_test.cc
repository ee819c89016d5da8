// Published test vectors: CRC-32 check value, FIPS 180-4 examples, RFC 8032 section 7.1.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/core/crypto/crc32.h"
#include "firmware/core/crypto/ed25519.h"

namespace armtrue {
namespace {

std::vector<std::uint8_t> from_hex(std::string_view text) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 2) {
    bytes.push_back(
        static_cast<std::uint8_t>(std::stoi(std::string(text.substr(i, 2)), nullptr, 16)));
  }
  return bytes;
}

std::vector<std::uint8_t> bytes_of(std::string_view text) { return {text.begin(), text.end()}; }

template <std::size_t kSize>
std::array<std::uint8_t, kSize> array_of(std::string_view hex) {
  const std::vector<std::uint8_t> bytes = from_hex(hex);
  std::array<std::uint8_t, kSize> result;
  EXPECT_EQ(bytes.size(), kSize);
  std::copy(bytes.begin(), bytes.end(), result.begin());
  return result;
}

TEST(Crc32Test, CheckValue) {
  EXPECT_EQ(crc32(bytes_of("123456789")), 0xCBF43926U);
  EXPECT_EQ(crc32({}), 0U);
}

TEST(Crc32Test, Crc32OfTwoPieces_EqualsThatOfTheWhole) {
  const std::vector<std::uint8_t> text = bytes_of("a table in two pieces");
  const auto first = std::span(text).first(7);
  EXPECT_EQ(crc32(std::span(text).subspan(7), crc32(first)), crc32(text));
}

TEST(Sha512Test, FipsExamples) {
  Sha512 abc;
  abc.update(bytes_of("abc"));
  EXPECT_EQ(abc.finish(),
            array_of<64>("ddaf35a193617abacc417349ae20413112e6fa4e89a97ea20a9eeee64b55d39a"
                         "2192992a274fc1a836ba3c23a3feebbd454d4423643ce80e2a9ac94fa54ca49f"));
  Sha512 longer;  // 896 bits: the padding takes a block of its own
  longer.update(
      bytes_of("abcdefghbcdefghicdefghijdefghijkefghijklfghijklmghijklmn"
               "hijklmnoijklmnopjklmnopqklmnopqrlmnopqrsmnopqrstnopqrstu"));
  EXPECT_EQ(longer.finish(),
            array_of<64>("8e959b75dae313da8cf4f72814fc143f8f7779c6eb9f7fa17299aeadb6889018"
                         "501d289e4900f7e4331b99dec4b5433ac7d329eeb6dd26545e96e55b874be909"));
}

struct Vector8032 {
  const char* seed;
  const char* key;
  const char* message;
  const char* signature;
};

constexpr Vector8032 kVectors[] = {
    {"9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
     "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a", "",
     "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bacc61e39701cf9b"
     "46b"
     "d25bf5f0595bbe24655141438e7a100b"},
    {"4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
     "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c", "72",
     "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da085ac1e43e15996e458f3613d0f11"
     "d8c"
     "387b2eaeb4302aeeb00d291612bb0c00"},
    {"c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7",
     "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025", "af82",
     "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac18ff9b538d16f290ae67f760984dc"
     "659"
     "4a7c15e9716ed28dc027beceea1ec40a"},
};

TEST(Ed25519Test, Rfc8032Vectors) {
  for (const Vector8032& vector : kVectors) {
    const auto seed = array_of<32>(vector.seed);
    const auto key = array_of<32>(vector.key);
    const auto signature = array_of<64>(vector.signature);
    const std::vector<std::uint8_t> message = from_hex(vector.message);
    EXPECT_EQ(public_key_ed25519(seed), key);
    EXPECT_EQ(sign_ed25519(seed, message), signature);
    EXPECT_TRUE(verify_ed25519(signature, key, message));
  }
}

TEST(Ed25519Test, AlteredSignatureMessageOrKey_IsRefused) {
  const auto key = array_of<32>(kVectors[2].key);
  const auto good = array_of<64>(kVectors[2].signature);
  const std::vector<std::uint8_t> message = from_hex(kVectors[2].message);
  for (std::size_t i = 0; i < good.size(); ++i) {
    auto bad = good;
    bad[i] ^= 1U;
    EXPECT_FALSE(verify_ed25519(bad, key, message)) << i;
  }
  const std::vector<std::uint8_t> other = from_hex("af83");
  EXPECT_FALSE(verify_ed25519(good, key, other));
  EXPECT_FALSE(verify_ed25519(good, array_of<32>(kVectors[1].key), message));
}

}  // namespace
}  // namespace armtrue
