// libFuzzer: any bytes as an expression. Nothing but ExpressionError may come out, what parses must
// write itself so that it parses to the same text, and deriving and evaluating it must end.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "fitter/model/expression/expression.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using armtrue::Expression;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    const Expression e = Expression::parse(text);
    const std::string written = e.to_string();
    if (Expression::parse(written).to_string() != written) std::abort();
    const std::set<std::string> variables = e.variables();
    const std::vector<double> column{0.3};
    const auto columns = [&](const std::string&) -> const std::vector<double>& { return column; };
    static_cast<void>(e.evaluate(1, columns));
    if (!variables.empty()) static_cast<void>(e.slopes(1, columns, *variables.begin()));
    static_cast<void>(e.to_json());
  } catch (const armtrue::ExpressionError&) {
  }
  return 0;
}
