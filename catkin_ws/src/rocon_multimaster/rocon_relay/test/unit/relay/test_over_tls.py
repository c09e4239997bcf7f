"""Links over TLS behave like plain ones: the tests of plain links, run with certificates."""

import pytest
import test_messages
import test_options
import test_parameters
import test_pressure
import test_services
import test_state

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture
def certificates(identities):
    return identities()


server, sink = test_services.server, test_services.sink

test_latched_messages_arrive = (
    test_messages.test_newcomers_get_the_last_latched_message_of_each_source
)
test_a_large_topic = test_messages.test_a_large_topic_can_be_left_and_joined_again_within_a_message
test_a_stalled_subscriber = (
    test_messages.test_a_stalled_subscriber_loses_the_oldest_and_slows_nobody
)
test_compressed_messages_arrive = test_options.test_compressed_messages_arrive_as_they_were_sent
test_a_parameter = test_parameters.test_a_parameter_is_copied_once_and_whole
test_a_slow_subscriber = test_pressure.test_a_slow_subscriber_slows_its_publisher_and_loses_nothing
test_a_dead_gateway = test_state.test_a_gateway_that_dies_is_noticed_and_found_again
test_a_credential = test_services.test_a_credential_holds_for_calls
test_an_error_of_the_server = test_services.test_an_error_of_the_server_is_an_error_to_the_client
test_a_late_reader = test_services.test_a_client_that_reads_late_gets_everything_and_holds_up_nobody
test_a_lost_link = test_services.test_a_lost_link_ends_a_call_with_an_error
test_calls_with_megabytes = test_services.test_megabytes_cross_both_ways_whole
