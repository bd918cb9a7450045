#include "ground_scale_vo/ros_tools/bag_topics.hpp"

#include <rosbag/view.h>

#include <algorithm>
#include <filesystem>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/drive_reader.hpp"

namespace gsv {

std::vector<std::string> spellingsOf(const std::string& topic) {
  const std::string name = topic.substr(std::min(topic.find_first_not_of('/'), topic.size()));
  return {"/" + name, name};
}

std::vector<std::string> imageTopics(const std::vector<const rosbag::Bag*>& bags,
                                     const std::string& topic) {
  for (const std::string& name : {topic, topic + "/compressed"}) {
    std::vector<std::string> found;
    for (const rosbag::Bag* bag : bags) {
      rosbag::View view(*bag, rosbag::TopicQuery(spellingsOf(name)));
      for (const rosbag::ConnectionInfo* connection : view.getConnections()) {
        const std::string& type = connection->datatype;
        if (type == "sensor_msgs/Image" || type == "sensor_msgs/CompressedImage") {
          found.push_back(connection->topic);
        }
      }
    }
    if (!found.empty()) return found;
  }
  return {};
}

void openBag(const std::string& file, rosbag::Bag* bag) {
  if (!std::filesystem::is_regular_file(file)) throw DataError("there is no bag " + file);
  const std::string type = std::filesystem::path(file).extension();
  if (type == ".mcap" || type == ".db3") requireNoBag(file);
  bag->open(file, rosbag::bagmode::Read);
}

std::string unreadableBag(const std::string& file, const std::exception& error) {
  const std::string reason = error.what();
  if (dynamic_cast<const rosbag::BagUnindexedException*>(&error) != nullptr ||
      reason.rfind("Error reading from file", 0) == 0) {
    return "the bag " + file + " has no index, because its recording or copy was not completed: " +
           "run rosbag reindex '" + file + "'";
  }
  return "the bag " + file + " cannot be read: " + reason;
}

}  // namespace gsv
