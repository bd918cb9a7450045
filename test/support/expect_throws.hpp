#pragma once

#include <gtest/gtest.h>

#include <string>

namespace gsv {

/// Expects that the action throws an Error whose message contains the text.
template <typename Error, typename Action>
void expectThrows(const Action& action, const std::string& text) {
  try {
    action();
    ADD_FAILURE() << "no error; expected: " << text;
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find(text), std::string::npos)
        << error.what() << "; expected: " << text;
  }
}

}  // namespace gsv
